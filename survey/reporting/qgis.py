"""QGIS projects (.qgz): styled layers in groups, with relative paths, CRS and view.

A `QgisLayer` is a file with the style in which it is drawn. `write_project` writes groups of layers as the XML
of QGIS in a zip archive. Rasters have hillshades, colour ramps or categories; routes, areas and points have
symbols.
"""

import io
import os
import zipfile
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal
from xml.etree import ElementTree as ET

import numpy as np
from matplotlib.colors import Colormap, to_hex, to_rgb
from pyproj import CRS

from survey.core import Bounds, FloatArray, write_bytes
from survey.figures.maps import SUPPORT
from survey.figures.style import DEVIATION, ELEVATION, INK, NO_GO, ROVERS

RasterStyle = Literal["elevation", "hillshade", "deviation", "support"]
VectorStyle = Literal["route", "area", "starts", "points"]


@dataclass(frozen=True)
class QgisLayer:
    """A file as a layer.

    `name`: name in the legend. `file`: a raster, or a GeoPackage or GeoJSON. `style`: how it is drawn.
    `band`: of rasters, counted from 1. `limits` (2,): of elevation and deviation: the values at the ends of
    the colours [m]. `table`: of vector files: the name of the layer within. `n_rovers`: of routes.
    `is_visible`: whether the layer is switched on when the project is opened.
    """

    name: str
    file: Path
    style: RasterStyle | VectorStyle
    band: int = 1
    limits: tuple[float, float] = (0.0, 1.0)
    table: str = ""
    n_rovers: int = 1
    is_visible: bool = True

    @property
    def is_raster(self) -> bool:
        """Whether the file is a raster."""
        return self.style in ("elevation", "hillshade", "deviation", "support")


@dataclass(frozen=True)
class QgisGroup:
    """Layers under one heading of the legend, the uppermost first.

    `name`: the heading. `layers`: its layers.
    """

    name: str
    layers: tuple[QgisLayer, ...]


def value_limits(values: FloatArray) -> tuple[float, float]:
    """Return lowest and highest known value, at least a millimetre apart.

    `values`: values [m], NaN where they are not known. Returns (2,): for `QgisLayer.limits`.

    >>> value_limits(np.array([1.0, np.nan, 3.0]))
    (1.0, 3.0)
    """
    low, high = float(np.nanmin(values)), float(np.nanmax(values))
    return low, max(high, low + 1e-3)


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

    `bounds` (4,): west, south, east, north of the view [m].
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
        _map_layer(layers, layer, crs, folder)
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
    write_bytes(path, buffer.getvalue())


def _all(groups: Sequence[QgisGroup]) -> Iterator[QgisLayer]:
    for group in groups:
        yield from group.layers


def _map_layer(parent: ET.Element, layer: QgisLayer, crs: CRS, folder: Path) -> None:
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


_STOPS = 9
_MULTIPLY = "6"


def add_raster_style(parent: ET.Element, layer: QgisLayer) -> None:
    """Add the drawing of a raster layer to its element."""
    pipe = ET.SubElement(parent, "pipe")
    if layer.style == "hillshade":
        facts = {"azimuth": "315", "angle": "45", "zfactor": "1", "multidirection": "0"}
        _renderer(pipe, "hillshade", layer, facts)
    elif layer.style == "support":
        palette = ET.SubElement(_renderer(pipe, "paletted", layer, {}), "colorPalette")
        for value, (label, colour) in SUPPORT.items():
            ET.SubElement(palette, "paletteEntry", value=str(value), color=colour, label=label, alpha="255")
    else:
        _ramp(pipe, layer, DEVIATION if layer.style == "deviation" else ELEVATION)
    ET.SubElement(pipe, "brightnesscontrast", brightness="0", contrast="0", gamma="1")
    smooth = "" if layer.style == "support" else "bilinear"
    ET.SubElement(pipe, "rasterresampler", maxOversampling="2", zoomedInResampler=smooth)
    ET.SubElement(parent, "blendMode").text = _MULTIPLY if layer.style == "hillshade" else "0"


def add_vector_style(parent: ET.Element, layer: QgisLayer) -> None:
    """Add the drawing of a vector layer to its element."""
    if layer.style == "route":
        _categories(parent, '"kind" || \' \' || "rover"', _route_symbols(layer.n_rovers))
    elif layer.style == "area":
        _categories(parent, "role", _area_symbols())
    else:
        renderer = ET.SubElement(parent, "renderer-v2", type="singleSymbol", symbollevels="0")
        symbols = ET.SubElement(renderer, "symbols")
        dot = {"name": "circle", "size": "0.8", "outline_style": "no", "color": _rgba(INK, 160)}
        start = {"name": "triangle", "size": "3.5", "color": _rgba(INK)}
        _symbol_layer(
            _symbol(symbols, "marker", "0"), "SimpleMarker", start if layer.style == "starts" else dot
        )
    ET.SubElement(parent, "blendMode").text = "0"


def _renderer(pipe: ET.Element, kind: str, layer: QgisLayer, facts: Mapping[str, str]) -> ET.Element:
    common = {"type": kind, "band": str(layer.band), "opacity": "1", "alphaBand": "-1", "nodataColor": ""}
    return ET.SubElement(pipe, "rasterrenderer", {**common, **facts})


def _ramp(pipe: ET.Element, layer: QgisLayer, colours: Colormap) -> None:
    """Add a continuous ramp between the limits of a layer."""
    low, high = (f"{value:.6g}" for value in layer.limits)
    facts = {"classificationMin": low, "classificationMax": high}
    shader = ET.SubElement(_renderer(pipe, "singlebandpseudocolor", layer, facts), "rastershader")
    ramp = ET.SubElement(
        shader, "colorrampshader", colorRampType="INTERPOLATED", classificationMode="1", clip="0",
        minimumValue=low, maximumValue=high,
    )  # fmt: skip
    for share in np.linspace(0.0, 1.0, _STOPS):
        value = f"{layer.limits[0] + share * (layer.limits[1] - layer.limits[0]):.6g}"
        ET.SubElement(
            ramp, "item", value=value, label=f"{value} m", color=to_hex(colours(share)), alpha="255"
        )


def _categories(parent: ET.Element, attribute: str, made: Mapping[str, tuple[str, ET.Element]]) -> None:
    """Add a renderer with one symbol for each value of an attribute or expression."""
    renderer = ET.SubElement(
        parent, "renderer-v2", type="categorizedSymbol", attr=attribute, symbollevels="0"
    )
    categories = ET.SubElement(renderer, "categories")
    symbols = ET.SubElement(renderer, "symbols")
    for index, (value, (label, symbol)) in enumerate(made.items()):
        symbol.set("name", str(index))
        symbols.append(symbol)
        facts = {"type": "string", "value": value, "symbol": str(index), "label": label, "render": "true"}
        ET.SubElement(categories, "category", facts)


def _route_symbols(n_rovers: int) -> dict[str, tuple[str, ET.Element]]:
    """Return swaths with an arrow in driving direction, and dashed transits, for each rover."""
    made = {}
    for rover in range(n_rovers):
        colour = _rgba(ROVERS[rover % len(ROVERS)])
        swath = _symbol(None, "line", "")
        _symbol_layer(swath, "SimpleLine", {"line_color": colour, "line_width": "0.6", "capstyle": "round"})
        arrows = _symbol_layer(swath, "MarkerLine", {"placement": "centralpoint", "rotate": "1"})
        arrow = {"name": "filled_arrowhead", "size": "3", "color": colour, "outline_style": "no"}
        _symbol_layer(_symbol(arrows, "marker", "@0@1"), "SimpleMarker", arrow)
        transit = _symbol(None, "line", "")
        _symbol_layer(
            transit, "SimpleLine", {"line_color": colour, "line_width": "0.35", "line_style": "dash"}
        )
        made[f"swath {rover}"] = (f"Rover {rover + 1}, swaths", swath)
        made[f"transit {rover}"] = (f"Rover {rover + 1}, transits", transit)
    return made


def _area_symbols() -> dict[str, tuple[str, ET.Element]]:
    outline, zone = _symbol(None, "fill", ""), _symbol(None, "fill", "")
    _symbol_layer(outline, "SimpleFill", {"style": "no", "outline_color": _rgba(INK), "outline_width": "0.5"})
    _symbol_layer(
        zone, "SimpleFill", {"style": "b_diagonal", "color": _rgba(NO_GO), "outline_color": _rgba(NO_GO)}
    )
    return {"area": ("Survey area", outline), "no-go": ("No-go", zone)}


def _symbol(parent: ET.Element | None, kind: str, name: str) -> ET.Element:
    facts = {"type": kind, "name": name, "alpha": "1", "clip_to_extent": "1", "force_rhr": "0"}
    return ET.Element("symbol", facts) if parent is None else ET.SubElement(parent, "symbol", facts)


def _symbol_layer(symbol: ET.Element, kind: str, facts: Mapping[str, str]) -> ET.Element:
    layer = ET.SubElement(symbol, "layer", {"class": kind, "pass": "0", "enabled": "1", "locked": "0"})
    for name, value in facts.items():
        ET.SubElement(layer, "prop", k=name, v=value)
    return layer


def _rgba(colour: str, alpha: int = 255) -> str:
    return ",".join(str(round(255 * value)) for value in to_rgb(colour)) + f",{alpha}"
