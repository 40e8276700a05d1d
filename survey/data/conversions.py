"""Plots of data types on matplotlib axes, HTML for notebooks, and conversion to xarray and GeoPandas.

Functions take arrays, so that every data type can use them; figures for reports stand in `survey.figures`. xarray and
GeoPandas are optional dependencies.
"""

import base64
import html
import io
from collections.abc import Callable, Iterable, Mapping, Sequence
from importlib import import_module
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np
import numpy.typing as npt
from affine import Affine
from pyproj import CRS

from survey.core.errors import InputError
from survey.core.text import insert_paragraphs

if TYPE_CHECKING:
    from geopandas import GeoDataFrame
    from matplotlib.axes import Axes
    from xarray import DataArray


_MOST_DRAWN_CELLS = 1000
"""Rows or columns of a raster beyond which cells are left out of a plot."""

_AXES = """\
Parameters
----------
ax : matplotlib.axes.Axes, optional
    Where to draw; a new figure by default.

Returns
-------
matplotlib.axes.Axes
    Easting and northing [m]."""
_Method = TypeVar("_Method", bound=Callable[..., Any])


def drawing(method: _Method) -> _Method:
    """Insert the parameter and the result of a ``plot`` for ``$axes`` in its docstring."""
    return insert_paragraphs(method, {"axes": _AXES})


def axes_or_new(ax: "Axes | None") -> "Axes":
    """Return the given axes, or those of a new figure."""
    if ax is not None:
        return ax
    from matplotlib import pyplot

    return pyplot.subplots()[1]


def plot_raster(
    ax: "Axes | None", values: npt.NDArray[Any], bounds: tuple[float, float, float, float], label: str
) -> "Axes":
    """Draw a north-up raster (H, W) within ``(xmin, ymin, xmax, ymax)`` [m], with a colour bar."""
    axes = axes_or_new(ax)
    step = max(1, -(-max(values.shape) // _MOST_DRAWN_CELLS))
    xmin, ymin, xmax, ymax = bounds
    image = axes.imshow(values[::step, ::step], extent=(xmin, xmax, ymin, ymax), interpolation="nearest")
    axes.figure.colorbar(image, ax=axes, label=label)
    return _as_map(axes)


def draw_lines(ax: "Axes | None", lines: Iterable[tuple[npt.NDArray[Any], Mapping[str, Any]]]) -> "Axes":
    """Draw lines (N, 2) [m], each with its matplotlib settings."""
    axes = axes_or_new(ax)
    for xy, settings in lines:
        axes.plot(xy[:, 0], xy[:, 1], **settings)
    if axes.get_legend_handles_labels()[0]:
        axes.legend()
    return _as_map(axes)


def draw_points(ax: "Axes | None", xy: npt.NDArray[Any], values: npt.NDArray[Any], label: str) -> "Axes":
    """Draw points (N, 2) [m] in the colour of their values (N,), with a colour bar."""
    axes = axes_or_new(ax)
    drawn = axes.scatter(xy[:, 0], xy[:, 1], c=values, s=4.0, linewidths=0.0)
    axes.figure.colorbar(drawn, ax=axes, label=label)
    return _as_map(axes)


def _as_map(axes: "Axes") -> "Axes":
    axes.set(xlabel="Easting [m]", ylabel="Northing [m]")
    axes.set_aspect("equal")
    axes.ticklabel_format(useOffset=False, style="plain")
    return axes


def html_table(title: str, facts: Mapping[str, str], draw: Callable[["Axes"], object] | None = None) -> str:
    """Return an HTML table of facts, beside a picture when `draw` draws one on given axes."""
    rows = "".join(
        f"<tr><th style='text-align:left'>{html.escape(name)}</th><td>{html.escape(value)}</td></tr>"
        for name, value in facts.items()
    )
    table = f"<table><caption>{html.escape(title)}</caption>{rows}</table>"
    if draw is None:
        return f"<div>{table}</div>"
    return f"<div style='display:flex;align-items:center'>{table}<img alt='{html.escape(title)}' src='{_picture(draw)}'></div>"


def _picture(draw: Callable[["Axes"], object]) -> str:
    """Return a small PNG picture as a data address."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(4.0, 3.0), layout="constrained")
    draw(figure.add_subplot())
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=72)
    return "data:image/png;base64," + base64.b64encode(buffer.getvalue()).decode("ascii")


def value_range(values: npt.NDArray[Any], unit: str = "m") -> str:
    """Return the range of the finite values as text.

    >>> value_range(np.array([1.0, np.nan, 2.5]))
    '1.0 to 2.5 m'
    """
    finite = values[np.isfinite(values)]
    return f"{finite.min():.1f} to {finite.max():.1f} {unit}" if finite.size else f"no values [{unit}]"


def optional(package: str, purpose: str, install: str = "firnline[notebook]") -> Any:
    """Import an optional package, which comes with what is to be installed."""
    try:
        return import_module(package)
    except ImportError as error:
        raise InputError(f"{purpose} needs {package}, which is not installed; install {install}.") from error


_METRES = ("", "m", "metre", "metres", "meter", "meters")


def raster_of(array: "DataArray", crs: Any = None) -> tuple[npt.NDArray[np.float64], Affine, Any]:
    """Return heights (H, W) [m], transform and CRS of an `xarray.DataArray`, its northern row first.

    The CRS is that of the coordinate which ``grid_mapping`` names, as CF and rioxarray write it; `crs` where none does.
    """
    where = f"the array {array.name!r}" if array.name else "the array"
    array = array.squeeze(drop=True)
    if array.ndim != 2:
        raise InputError(f"{where} has the dimensions {array.dims}; two were expected, rows and columns.")
    unit = str(array.attrs.get("units", ""))
    if unit.lower() not in _METRES:
        raise InputError(f"{where} is in {unit!r}; multiply it to metres, and set attrs['units'] = 'm'.")
    (y, step_y), (x, step_x) = (_steps(array, name, where) for name in array.dims)
    if not np.isclose(abs(step_x), abs(step_y), rtol=1e-6):
        raise InputError(
            f"{where} has cells of {abs(step_x):g} × {abs(step_y):g} m; square ones were expected."
        )
    values = np.array(array.values, dtype=np.float64)
    missing = array.attrs.get("_FillValue", array.attrs.get("nodata"))
    if missing is not None:
        values[values == missing] = np.nan
    values, x, y = values[:: 1 if step_y < 0.0 else -1, :: 1 if step_x > 0.0 else -1], np.sort(x), np.sort(y)
    step = abs(step_x)
    transform = Affine(step, 0.0, x[0] - 0.5 * step, 0.0, -step, y[-1] + 0.5 * step)
    return values, transform, _crs_of(array, crs, where)


def _steps(array: "DataArray", name: Any, where: str) -> tuple[npt.NDArray[np.float64], float]:
    """Return the coordinates along a dimension [m], and their step, which is negative where they fall."""
    if name not in array.coords or array.sizes[name] < 2:
        raise InputError(
            f"{where} has no coordinates along {name!r}; two or more centres of cells [m] were expected."
        )
    places = np.asarray(array.coords[name].values, dtype=np.float64)
    steps = np.diff(places)
    step = float(steps[0])
    uneven = ~(np.abs(steps - step) <= 1e-3 * abs(step))
    if step == 0.0 or uneven.any():
        raise InputError(
            f"{where} has uneven steps along {name!r}, {steps[np.argmax(uneven)]:g} after {places[np.argmax(uneven)]:g} and {step:g} "
            "else; interpolate it on even ones."
        )
    return places, float((places[-1] - places[0]) / (len(places) - 1))


def _crs_of(array: "DataArray", crs: Any, where: str) -> Any:
    """Return what states the CRS of an array."""
    named = array.encoding.get("grid_mapping", array.attrs.get("grid_mapping", "spatial_ref"))
    facts = array.coords[named].attrs if named in array.coords else array.attrs
    for key in ("crs_wkt", "spatial_ref", "crs"):
        if facts.get(key):
            return facts[key]
    if crs is not None:
        return crs
    raise InputError(f"{where} states no CRS; write one by rioxarray (rio.write_crs), or name it with crs=.")


def to_geodataframe(geometry: Sequence[Any], columns: Mapping[str, Any], crs: CRS) -> "GeoDataFrame":
    """Return a `geopandas.GeoDataFrame` with one row for each geometry.

    `geometry`: geometries [m].
    """
    geopandas = optional("geopandas", "to_geodataframe")
    frame: GeoDataFrame = geopandas.GeoDataFrame(dict(columns), geometry=list(geometry), crs=crs)
    return frame
