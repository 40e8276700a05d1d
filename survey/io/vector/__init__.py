"""Vector files: GeoPackage, GeoJSON, KML, KMZ, Shapefile, FlatGeobuf, GPX, through GDAL."""

from survey.io.vector.reading import Features, geometry_types, layer_names, polygon_layer, read_features
from survey.io.vector.writing import write_features

__all__ = [
    "Features",
    "geometry_types",
    "layer_names",
    "polygon_layer",
    "read_features",
    "write_features",
]
