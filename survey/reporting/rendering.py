"""Rendering of HTML pages: templates, tables for download, and pictures.

`render` fills a template of ``survey/reporting/templates``; `csv_source` embeds a table as a data URI. A
`Picture` is a figure as a file for download and as WebP for the page, with a narrow version for phones where it
takes the width of a page.
"""

import base64
import csv
import io
from collections.abc import Callable, Iterable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import NamedTuple, Self

from jinja2 import Environment, PackageLoader, StrictUndefined
from matplotlib.figure import Figure
from PIL import Image

from survey.core import PictureKind
from survey.core.text import csv_cell
from survey.figures.layout import Paper, arranged, column_width_in, is_wide, narrow_image
from survey.figures.style import page_image, picture_bytes, styled

_SPACES = str.maketrans({"\u00a0": " ", "\u202f": "", "\u2009": "", "\u2212": "-"})


def render(template: str, **content: object) -> str:
    """Return a page from its template; text is escaped, and a name that is missing is an error."""
    environment = Environment(
        loader=PackageLoader("survey.reporting", "templates"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )
    environment.filters["csv_source"] = csv_source
    return environment.get_template(template).render(**content)


def csv_source(rows: Iterable[Sequence[object]]) -> str:
    r"""Return rows as a data URI of CSV, for the download of a table; formulas are escaped.

    >>> base64.b64decode(csv_source([["RMSE", "0.4\u00a0m"]]).split(",")[1]).decode()
    'RMSE,0.4 m\n'
    """
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    for row in rows:
        plain = [str(cell).translate(_SPACES) for cell in row]
        # A minus sign begins numbers, not formulas.
        writer.writerow([cell if cell[:2].strip("-").isdigit() else csv_cell(cell) for cell in plain])
    return "data:text/csv;base64," + base64.b64encode(text.getvalue().encode("utf-8")).decode("ascii")


_SCALE = 2
_QUALITY = 90
# Effort of the encoder, 0 to 6: half the time of the default 4 for 4 % larger images.
_EFFORT = 2
# Level of the PNG compression, 0 to 9: two thirds of the time of level 4, and 11 % larger.
_COMPRESSION = 2


class Shown(NamedTuple):
    """What a page shows: WebP, a quarter as large as the PNG, with width and height in CSS pixels."""

    webp: bytes
    size: tuple[int, int]

    @classmethod
    def of(cls, image: Image.Image) -> Self:
        """Encode an image (RGB) of two pixels for each CSS pixel."""
        webp = _encoded(image, format="webp", quality=_QUALITY, method=_EFFORT)
        return cls(webp, (round(image.width / _SCALE), round(image.height / _SCALE)))

    @property
    def source(self) -> str:
        """The image as a data URI."""
        return _uri(self.webp, "webp")


class Picture(NamedTuple):
    """Figure or animation of a page: file for download, alternative text, caption, and what the page shows.

    `narrow` is for phones, of a picture that takes the width of a page.
    """

    image: bytes
    kind: str
    alt: str
    caption: str
    shown: Shown
    narrow: Shown | None = None

    @property
    def file_source(self) -> str:
        """The file itself as a data URI."""
        return _uri(self.image, self.kind)

    @property
    def is_wide(self) -> bool:
        """Whether it takes the width of a page."""
        return self.narrow is not None


_PRINT_DPI = 300


class PictureForm(NamedTuple):
    """Format of a picture, and the publisher whose columns it fits; without one it has the width of the screen."""

    kind: PictureKind = "png"
    paper: Paper | None = None

    def render(self, figure: Figure) -> bytes:
        """Draw a figure as the content of a file; the figure itself stays as it is."""
        return self._at_column_width(figure) if self.paper else picture_bytes(figure, self.kind)

    @styled
    def _at_column_width(self, figure: Figure) -> bytes:
        assert self.paper is not None
        with arranged(figure, column_width_in(figure, self.paper)):
            return picture_bytes(figure, self.kind, _PRINT_DPI)


PNG = PictureForm()
"""Form of pictures that are not asked for in another one."""


class Drawing(NamedTuple):
    """Figure with its alternative text and caption."""

    figure: Figure
    alt: str
    caption: str


def picture_of(figure: Figure, alt: str, caption: str, form: PictureForm = PNG) -> Picture:
    """Draw a figure for a page, for phones where it takes the width of a page, and as a file for download."""
    return _encoder(Drawing(figure, alt, caption), form)()


def pictures_of(drawings: Mapping[str, Drawing], form: PictureForm = PNG) -> dict[str, Picture]:
    """Draw figures one after the other, as `picture_of` does; threads encode those that are drawn."""
    with ThreadPoolExecutor() as threads:
        encoding = {name: threads.submit(_encoder(drawing, form)) for name, drawing in drawings.items()}
        return {name: picture.result() for name, picture in encoding.items()}


def _encoder(drawing: Drawing, form: PictureForm) -> Callable[[], Picture]:
    """Draw a figure, and return the function that encodes it, which lets other threads run."""
    image = page_image(drawing.figure)
    narrow = narrow_image(drawing.figure) if is_wide(drawing.figure) else None
    # The file of the usual form holds the pixels of the page.
    file = None if form == PNG else form.render(drawing.figure)

    def encode() -> Picture:
        content = _encoded(image, format="png", compress_level=_COMPRESSION) if file is None else file
        small = None if narrow is None else Shown.of(narrow)
        return Picture(content, form.kind, drawing.alt, drawing.caption, Shown.of(image), small)

    return encode


def animation_of(webp: bytes, alt: str, caption: str) -> Picture:
    """Return the picture of an animated WebP of one pixel for each CSS pixel."""
    # The extended format, which animations have, states the canvas less one, in 24 bits each.
    width, height = (int.from_bytes(webp[at : at + 3], "little") + 1 for at in (24, 27))
    return Picture(webp, "webp", alt, caption, Shown(webp, (width, height)))


def _encoded(image: Image.Image, **settings: object) -> bytes:
    """Return an image as the content of a file, by the settings of Pillow."""
    buffer = io.BytesIO()
    image.save(buffer, **settings)  # type: ignore[arg-type]
    return buffer.getvalue()


def _uri(content: bytes, kind: str) -> str:
    return f"data:image/{kind};base64,{base64.b64encode(content).decode('ascii')}"
