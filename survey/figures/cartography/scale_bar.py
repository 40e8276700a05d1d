"""Scale bar and north arrow."""

from typing import Any

from matplotlib.axes import Axes
from matplotlib.patches import Rectangle
from matplotlib.transforms import ScaledTranslation, blended_transform_factory
from pyproj import CRS

from survey.core.map_scale import MapScale
from survey.core.quantity_text import round_number
from survey.figures.cartography.layout import MapFigure, grouped
from survey.figures.style import INK


def draw_scale_and_north(drawing: MapFigure, *, north: bool = True, crs: CRS | None = None) -> None:
    """Draw a scale bar and, where the map has one, a grid-north arrow above the map, where they cover nothing.

    With `crs` the bar counts on the ground where the scale factor of the CRS differs from 1 by more than 1 %.
    """
    axes = drawing.maps[0]
    xmin, xmax = axes.get_xlim()
    width = xmax - xmin
    factor = 1.0 if crs is None else _scale_factor(axes, crs)
    ground_m = round_number(width / factor / 4.0)
    length = ground_m * factor
    end = xmax - 0.09 * width
    inches_above = drawing.figure.dpi_scale_trans + ScaledTranslation(0.0, 1.0, axes.transAxes)  # type: ignore[arg-type]  # it is affine
    place = blended_transform_factory(axes.transData, inches_above)
    across = blended_transform_factory(axes.transAxes, inches_above)
    for start, colour in ((end - length, INK), (end - length / 2.0, "white")):
        bar: dict[str, Any] = {
            "facecolor": colour,
            "edgecolor": INK,
            "linewidth": 0.8,
            "clip_on": False,
            "transform": place,
        }
        axes.add_patch(Rectangle((start, 0.10), length / 2.0, 0.08, **bar))
    text = f"{grouped(ground_m / 1000.0)} km" if ground_m >= 1000.0 else f"{ground_m:g} m"
    axes.text(end - length - 0.015 * width, 0.14, text, transform=place, ha="right", va="center", fontsize=8)
    if not north:
        return
    axes.text(0.955, 0.14, "N", transform=across, ha="center", va="center", fontweight="bold")
    arrow = {"arrowstyle": "-|>", "color": INK, "mutation_scale": 12, "shrinkA": 0, "shrinkB": 0}
    axes.annotate(
        "",
        xy=(0.985, 0.34),
        xytext=(0.985, 0.03),
        xycoords=across,
        arrowprops=arrow,
        annotation_clip=False,
    )


def _scale_factor(axes: Axes, crs: CRS) -> float:
    """Return the linear scale factor of a CRS over what a map shows; 1 within 1 %."""
    (west, east), (south, north) = axes.get_xlim(), axes.get_ylim()
    return MapScale.over(crs, (west, south, east, north)).notable_factor
