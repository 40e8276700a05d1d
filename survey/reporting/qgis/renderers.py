"""Renderers of QGIS: hillshade, colour ramps and categories of rasters; symbols of routes, areas and points."""

from collections.abc import Mapping
from xml.etree import ElementTree as ET

import numpy as np
from matplotlib.colors import Colormap, to_hex, to_rgb

from survey.figures.maps import SUPPORT
from survey.figures.style import DEVIATION, ELEVATION, INK, NO_GO, ROVERS
from survey.reporting.qgis.layers import QgisLayer

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
        _layer(_symbol(symbols, "marker", "0"), "SimpleMarker", start if layer.style == "starts" else dot)
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
        _layer(swath, "SimpleLine", {"line_color": colour, "line_width": "0.6", "capstyle": "round"})
        arrows = _layer(swath, "MarkerLine", {"placement": "centralpoint", "rotate": "1"})
        arrow = {"name": "filled_arrowhead", "size": "3", "color": colour, "outline_style": "no"}
        _layer(_symbol(arrows, "marker", "@0@1"), "SimpleMarker", arrow)
        transit = _symbol(None, "line", "")
        _layer(transit, "SimpleLine", {"line_color": colour, "line_width": "0.35", "line_style": "dash"})
        made[f"swath {rover}"] = (f"Rover {rover + 1}, swaths", swath)
        made[f"transit {rover}"] = (f"Rover {rover + 1}, transits", transit)
    return made


def _area_symbols() -> dict[str, tuple[str, ET.Element]]:
    outline, zone = _symbol(None, "fill", ""), _symbol(None, "fill", "")
    _layer(outline, "SimpleFill", {"style": "no", "outline_color": _rgba(INK), "outline_width": "0.5"})
    _layer(zone, "SimpleFill", {"style": "b_diagonal", "color": _rgba(NO_GO), "outline_color": _rgba(NO_GO)})
    return {"area": ("Survey area", outline), "no-go": ("No-go", zone)}


def _symbol(parent: ET.Element | None, kind: str, name: str) -> ET.Element:
    facts = {"type": kind, "name": name, "alpha": "1", "clip_to_extent": "1", "force_rhr": "0"}
    return ET.Element("symbol", facts) if parent is None else ET.SubElement(parent, "symbol", facts)


def _layer(symbol: ET.Element, kind: str, facts: Mapping[str, str]) -> ET.Element:
    layer = ET.SubElement(symbol, "layer", {"class": kind, "pass": "0", "enabled": "1", "locked": "0"})
    for name, value in facts.items():
        ET.SubElement(layer, "prop", k=name, v=value)
    return layer


def _rgba(colour: str, alpha: int = 255) -> str:
    return ",".join(str(round(255 * value)) for value in to_rgb(colour)) + f",{alpha}"
