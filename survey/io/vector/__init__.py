"""Vector files: GeoPackage, GeoJSON, KML, KMZ, Shapefile, FlatGeobuf, GPX, through GDAL."""

from survey.io.vector.reading import Features, geometry_types, layer_names, polygon_layer, read_features
from survey.io.vector.writing import Layer, write_features, write_layers

__all__ = [
    "Features",
    "Layer",
    "geometry_types",
    "layer_names",
    "polygon_layer",
    "read_features",
    "write_features",
    "write_layers",
]
