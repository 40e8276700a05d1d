"""Measures of pictures in print, as `tests.accessibility` has those of pages."""

import xml.etree.ElementTree as ET

from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.text import Text

from survey.figures.style import FULL_IN, styled

LEAST_PT, PAGE_IN = 6.0, 180.0 / 25.4
"""Smallest letters [pt] where a figure of a page's width is printed 180 mm wide."""
_EDGE_IN = 0.02


@styled
def assert_printable(figure: Figure, share: float = PAGE_IN / FULL_IN) -> None:
    """Measure letters and edges of a figure that is printed at a share of its size."""
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    letters = [text for text in figure.findobj(Text) if text.get_visible() and text.get_text().strip()]
    smallest = min(letters, key=lambda text: text.get_fontsize())
    assert smallest.get_fontsize() * share >= LEAST_PT, smallest.get_text()
    box, (width, height) = figure.get_tightbbox(canvas.get_renderer()), figure.get_size_inches()
    cut = {"left": -box.x0, "below": -box.y0, "right": box.x1 - width, "above": box.y1 - height}
    assert max(cut.values()) <= _EDGE_IN, cut


def assert_fonts_embedded(pdf: bytes, svg: bytes) -> None:
    """Find every font in a PDF as TrueType, and no letter in an SVG that needs a font."""
    assert pdf.count(b"/Type /FontDescriptor") == pdf.count(b"/FontFile2") > 0
    assert b"/Type3" not in pdf
    assert not list(ET.fromstring(svg).iter("{http://www.w3.org/2000/svg}text"))
