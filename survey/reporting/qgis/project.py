"""QGIS project files (.qgz): groups of layers with relative paths, CRS and view."""

import io
import os
import zipfile
from collections.abc import Iterator, Sequence
from pathlib import Path
from xml.etree import ElementTree as ET

from pyproj import CRS

from survey.core.arrays import Bounds
from survey.core.files.writing import replacing
from survey.reporting.qgis.layers import QgisGroup, QgisLayer
from survey.reporting.qgis.renderers import add_raster_style, add_vector_style

_VERSION = "3.22.0"
_FIRST_DAY = (1980, 1, 1, 0, 0, 0)
_HEADER = b"<!DOCTYPE qgis PUBLIC 'http://mrcc.com/qgis.dtd' 'SYSTEM'>\n"
_GEOMETRY = {"route": "Line", "area": "Polygon", "starts": "Point", "points": "Point"}
# The file of an area holds polygons and points in one table.
_MIXED = ("area", "starts")


def write_project(
    path: str | Path,
    title: str,
    groups: Sequence[QgisGroup],
    crs: CRS,
    bounds: Bounds,
    *,
    place: Path | None = None,
) -> None:
    """Write a project that QGIS 3.22 and later open with every layer in its style.

    Equal input gives equal bytes. Files are named relative to the project, so that the folder can be moved.

    Parameters
    ----------
    path : str or pathlib.Path
        Ends in ``.qgz``.
    title : str
        Title of the project.
    groups : sequence of QgisGroup
        The uppermost first.
    crs : pyproj.CRS
        Projected CRS of project and layers.
    bounds : (4,) tuple of float
        West, south, east, north of the view [m].
    place : pathlib.Path, optional
        Where the project will stand, if it is written elsewhere first.
    """
    folder = (place or Path(path)).absolute().parent
    root = ET.Element("qgis", projectname=title, version=_VERSION)
    ET.SubElement(root, "title").text = title
    _crs(ET.SubElement(root, "projectCrs"), crs)
    tree = ET.SubElement(root, "layer-tree-group")
    for group in groups:
        branch = ET.SubElement(tree, "layer-tree-group", name=group.name, checked="Qt::Checked", expanded="1")
        for layer in group.layers:
            _leaf(branch, layer, folder)
    _view(root, crs, bounds)
    layers = ET.SubElement(root, "projectlayers")
    for layer in _all(groups):
        _layer(layers, layer, crs, folder)
    order = ET.SubElement(root, "layerorder")
    for layer in _all(groups):
        ET.SubElement(order, "layer", id=_name(layer))
    _properties(root)
    ET.indent(root)
    _write(Path(path), _HEADER + bytes(ET.tostring(root, encoding="utf-8")) + b"\n")


def _write(path: Path, content: bytes) -> None:
    """Write the project into its archive, dated alike whenever it is written."""
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr(zipfile.ZipInfo(f"{path.stem}.qgs", _FIRST_DAY), content)
    with replacing(path) as draft:
        draft.write_bytes(buffer.getvalue())


def _all(groups: Sequence[QgisGroup]) -> Iterator[QgisLayer]:
    for group in groups:
        yield from group.layers


def _layer(parent: ET.Element, layer: QgisLayer, crs: CRS, folder: Path) -> None:
    kind = {"type": "raster"} if layer.is_raster else {"type": "vector", "geometry": _GEOMETRY[layer.style]}
    element = ET.SubElement(parent, "maplayer", {**kind, "hasScaleBasedVisibilityFlag": "0"})
    ET.SubElement(element, "id").text = _name(layer)
    ET.SubElement(element, "datasource").text = _source(layer, folder)
    ET.SubElement(element, "layername").text = layer.name
    _crs(ET.SubElement(element, "srs"), crs)
    ET.SubElement(element, "provider", encoding="UTF-8").text = _provider(layer)
    if layer.is_raster:
        add_raster_style(element, layer)
    else:
        add_vector_style(element, layer)


def _leaf(branch: ET.Element, layer: QgisLayer, folder: Path) -> None:
    checked = "Qt::Checked" if layer.is_visible else "Qt::Unchecked"
    ET.SubElement(
        branch, "layer-tree-layer", id=_name(layer), name=layer.name, source=_source(layer, folder),
        providerKey=_provider(layer), checked=checked, expanded="0",
    )  # fmt: skip


def _provider(layer: QgisLayer) -> str:
    return "gdal" if layer.is_raster else "ogr"


def _name(layer: QgisLayer) -> str:
    """Return the identifier of a layer: its name and style in letters, digits and underscores."""
    text = f"{layer.name}_{layer.style}_{layer.file.stem}_{layer.band}"
    return "".join(letter if letter.isalnum() else "_" for letter in text)


def _source(layer: QgisLayer, folder: Path) -> str:
    relative = Path(os.path.relpath(layer.file.absolute(), folder)).as_posix()
    source = relative if relative.startswith("../") else f"./{relative}"
    if layer.is_raster:
        return source
    kind = f"|geometrytype={_GEOMETRY[layer.style]}" if layer.style in _MIXED else ""
    return f"{source}|layername={layer.table}{kind}"


def _crs(parent: ET.Element, crs: CRS) -> None:
    system = ET.SubElement(parent, "spatialrefsys", nativeFormat="Wkt")
    ET.SubElement(system, "wkt").text = crs.to_wkt()
    authority = crs.to_authority(min_confidence=100)
    if authority is not None:
        ET.SubElement(system, "authid").text = ":".join(authority)


def _properties(root: ET.Element) -> None:
    """State that paths are relative, and that the project has a CRS, without which QGIS ignores it."""
    properties = ET.SubElement(root, "properties")
    ET.SubElement(ET.SubElement(properties, "Paths"), "Absolute", type="bool").text = "false"
    projections = ET.SubElement(properties, "SpatialRefSys")
    ET.SubElement(projections, "ProjectionsEnabled", type="int").text = "1"


def _view(root: ET.Element, crs: CRS, bounds: Bounds) -> None:
    canvas = ET.SubElement(root, "mapcanvas", name="theMapCanvas")
    ET.SubElement(canvas, "units").text = "meters"
    extent = ET.SubElement(canvas, "extent")
    for name, value in zip(("xmin", "ymin", "xmax", "ymax"), bounds, strict=True):
        ET.SubElement(extent, name).text = repr(float(value))
    _crs(ET.SubElement(canvas, "destinationsrs"), crs)
