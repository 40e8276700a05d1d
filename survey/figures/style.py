"""Style of all figures: colours, sizes, and rendering to PNG, PDF and SVG.

Fonts, lines and the embedding of fonts stand in ``firnline.mplstyle``. `picture_bytes` and `write_pictures` render
for every command that draws.
"""

import io
from collections.abc import Callable, Mapping
from functools import cache, wraps
from importlib.util import find_spec
from pathlib import Path
from typing import Any, ParamSpec, TypeVar

import matplotlib.style
import numpy as np
import numpy.typing as npt
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import ListedColormap, Normalize
from matplotlib.figure import Figure
from matplotlib.font_manager import fontManager
from PIL.Image import Image, frombuffer

from survey.core.files import PictureKind, replacing
from survey.core.text import insert_paragraphs

FULL_IN = 9.0
"""Width of a figure over the full page [in]; the report shows 120 CSS pixels per inch."""
HALF_IN = 4.4
"""Width of a figure that shares the page with another one [in]."""
DPI = 144
SHARP_DPI = 240
"""Pixels per inch of figures in pages: two for each CSS pixel."""
_COMPRESSION = 6

INK = "#1d2a35"
MUTED = "#66727c"
VEIL = "#e6e9ec"
REFERENCE = "#1d2a35"
ESTIMATE = "#d55e00"
PRIOR = "#8a8f94"
CLAIM = "#0072b2"
NO_GO = "#b3262b"
ROVERS = ("#d55e00", "#0072b2", "#009e73", "#aa4499", "#b58900", "#332288")
"""One colour for each rover; after the last one they begin again."""


def _scientific(name: str) -> ListedColormap:
    """Return a colour map of Crameri (2018) from the files of cmcrameri, whose import takes 0.3 s for pyplot."""
    package = find_spec("cmcrameri")
    folder = Path((package and package.origin) or "").parent
    return ListedColormap(np.loadtxt(folder / "cmaps" / f"{name}.txt"), name=name)


ELEVATION = ListedColormap(_scientific("davos")(np.linspace(0.35, 0.96, 256)), name="ice")
ERROR = _scientific("vik")
DEVIATION = ListedColormap(_scientific("lajolla").reversed()(np.linspace(0.0, 0.85, 256)), name="deviation")
DENSITY = _scientific("devon").reversed()

_STYLE = Path(__file__).with_name("firnline.mplstyle")

_RETURNS = "Returns\n-------\nmatplotlib.figure.Figure\n    As wide as "
_PARAGRAPHS = {
    "reconstruction": "reconstruction : Reconstruction\n    The survey's map.",
    "reference": "reference : Dem\n    The terrain as it is.",
    "area_shown": "area : SurveyArea, optional\n    Only nodes inside are shown.",
    "area_counted": "area : SurveyArea, optional\n    Only nodes inside count.",
    "area_extent": "area : SurveyArea, optional\n    Its outline is drawn and sets the extent of the map.",
    "swaths": "route : Route, optional\n    Its swaths are drawn as thin lines.",
    "width": "width_in : float\n    Width of the figure [in].",
    "half_page": f"{_RETURNS}half a page.",
    "page": f"{_RETURNS}a page.",
    "two_surfaces": """\
>>> from survey.data.grid import Grid
>>> grid = Grid((0.0, 0.0, 60.0, 40.0), 2.0)
>>> flat, raised = (Dem.on(grid, np.full(grid.shape, z)) for z in (5.0, 5.25))
>>> surveyed = Reconstruction(raised, flat, np.full(grid.shape, 3), "tin", {})""",
}
"""Paragraphs that docstrings of figures share: each stands there as ``$name``."""

_Arguments = ParamSpec("_Arguments")
_Result = TypeVar("_Result")


def styled(draw: Callable[_Arguments, _Result]) -> Callable[_Arguments, _Result]:
    """Run a drawing function with the report's matplotlib settings; insert shared paragraphs into its docstring."""

    @wraps(insert_paragraphs(draw, _PARAGRAPHS))
    def under_style(*args: _Arguments.args, **kwargs: _Arguments.kwargs) -> _Result:
        with matplotlib.style.context(_settings(), after_reset=True):
            return draw(*args, **kwargs)

    return under_style


@cache
def _settings() -> dict[str, Any]:
    """Read the style once, and add to matplotlib's list of fonts those that it brings and its stored list lacks.

    The stored list is incomplete where it was made while matplotlib was being installed.
    """
    for file in unlisted_fonts():
        fontManager.addfont(file)
    read: Any = matplotlib.rc_params_from_file(_STYLE, use_default_template=False)
    return dict(read)


def unlisted_fonts() -> list[Path]:
    """Return the fonts that matplotlib brings and its list of fonts lacks."""
    listed = {Path(font.fname).name for font in fontManager.ttflist}
    brought = Path(matplotlib.get_data_path(), "fonts", "ttf").glob("*.ttf")
    return sorted(file for file in brought if file.name not in listed)


@styled
def png_bytes(figure: Figure, dpi: int = DPI) -> bytes:
    r"""Render a figure; the same figure gives the same bytes (no date, no program name).

    >>> png_bytes(Figure((1.0, 1.0)))[:4]
    b'\x89PNG'
    """
    buffer = io.BytesIO()
    _drawn(figure, dpi).save(buffer, "PNG", dpi=(dpi, dpi), compress_level=_COMPRESSION)
    return buffer.getvalue()


@styled
def picture_bytes(figure: Figure, kind: PictureKind = "png", dpi: int = DPI) -> bytes:
    r"""Render a figure as PNG, PDF or SVG with its fonts embedded; the same figure gives the same bytes.

    Parameters
    ----------
    figure
        Figure to render.
    kind
        Format of the picture.
    dpi
        Pixels per inch of a PNG.

    Returns
    -------
    bytes
        Content of the file.

    Examples
    --------
    >>> picture_bytes(Figure((1.0, 1.0)), "pdf")[:4]
    b'%PDF'
    """
    if kind == "png":
        return png_bytes(figure, dpi)
    buffer = io.BytesIO()
    undated: dict[str, str | None] = {"Creator": "firnline"}
    undated["CreationDate" if kind == "pdf" else "Date"] = None
    figure.savefig(buffer, format=kind, dpi=SHARP_DPI, metadata=undated)
    return buffer.getvalue()


def write_pictures(folder: Path, figures: Mapping[str, Figure], kind: PictureKind = "png") -> None:
    """Write figures into a folder, each under its name with the ending of the format."""
    for name, figure in figures.items():
        with replacing(folder / f"{name}.{kind}") as draft:
            draft.write_bytes(picture_bytes(figure, kind))


@styled
def page_image(figure: Figure) -> Image:
    """Draw a figure for a page: two pixels for each CSS pixel."""
    return _drawn(figure, SHARP_DPI).convert("RGB")


def _drawn(figure: Figure, dpi: int) -> Image:
    """Draw a figure in red, green, blue and opacity, with so many pixels per inch.

    `Figure.savefig` draws a figure twice, first for its layout; here it is laid out and drawn at once, with the same
    pixels. Canvas and resolution of the figure stay as they are.
    """
    canvas, own_dpi = figure.canvas, figure.dpi
    drawn: Any = FigureCanvasAgg(figure)
    try:
        figure.set_dpi(dpi)
        drawn.draw()
        return frombuffer("RGBA", drawn.get_width_height(), drawn.buffer_rgba())
    finally:
        figure.set_dpi(own_dpi)
        figure.set_canvas(canvas)


def symmetric_limits(errors: npt.ArrayLike) -> Normalize:
    """Return colour limits that are equal on both sides of zero and hold 99 % of the errors."""
    finite = np.asarray(errors)[np.isfinite(errors)]
    limit = float(np.percentile(np.abs(finite), 99.0)) if finite.size else 1.0
    return Normalize(-max(limit, 1e-9), max(limit, 1e-9))
