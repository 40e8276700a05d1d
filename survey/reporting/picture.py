"""Picture of a page: PNG or animated WebP with its alternative text, its caption and a narrow version for phones."""

import base64
import io
import struct
from typing import NamedTuple

from matplotlib.figure import Figure
from PIL import Image

from survey.figures.narrow import narrow_png
from survey.figures.style import page_png_bytes

_SCALE = 2
_WIDE_IN = 6.0
_QUALITY = 90
# Effort of the encoder, 0 to 6: half the time of the default 4 for 4 % larger images.
_EFFORT = 2


class Picture(NamedTuple):
    """Figure of a page: PNG of two pixels for each CSS pixel, or animated WebP; alternative text; caption.

    `narrow` is the PNG for phones of a picture that takes the width of a page.
    """

    image: bytes
    alt: str
    caption: str
    narrow: bytes | None = None

    @property
    def kind(self) -> str:
        """Its format, by its first bytes."""
        return "webp" if self.image.startswith(b"RIFF") else "png"

    @property
    def source(self) -> str:
        """What the page shows, as a data URI: WebP, a quarter as large as the PNG."""
        return _webp_source(self.image if self.kind == "webp" else _as_webp(self.image))

    @property
    def narrow_source(self) -> str | None:
        """What the page shows on a phone, as a data URI; None where it is the same."""
        return None if self.narrow is None else _webp_source(_as_webp(self.narrow))

    @property
    def file_source(self) -> str:
        """The file itself as a data URI."""
        return f"data:image/{self.kind};base64,{base64.b64encode(self.image).decode('ascii')}"

    @property
    def size(self) -> tuple[int, int]:
        """Width and height in CSS pixels, from the header."""
        if self.kind == "webp":
            # The extended format, which animations have, states the canvas less one, in 24 bits each.
            width, height = (int.from_bytes(self.image[at : at + 3], "little") + 1 for at in (24, 27))
            return width, height
        return _png_size(self.image)

    @property
    def narrow_size(self) -> tuple[int, int]:
        """Width and height for phones in CSS pixels."""
        return self.size if self.narrow is None else _png_size(self.narrow)

    @property
    def is_wide(self) -> bool:
        """Whether it takes the width of a page."""
        return self.narrow is not None


def picture_of(figure: Figure, alt: str, caption: str) -> Picture:
    """Render a figure for a page."""
    is_wide = figure.get_figwidth() > _WIDE_IN
    return Picture(page_png_bytes(figure), alt, caption, narrow_png(figure) if is_wide else None)


def _png_size(png: bytes) -> tuple[int, int]:
    """Return width and height in CSS pixels, from the header."""
    width, height = struct.unpack(">II", png[16:24])
    return round(width / _SCALE), round(height / _SCALE)


def _webp_source(webp: bytes) -> str:
    return f"data:image/webp;base64,{base64.b64encode(webp).decode('ascii')}"


def _as_webp(png: bytes) -> bytes:
    buffer = io.BytesIO()
    with Image.open(io.BytesIO(png)) as image:
        image.convert("RGB").save(buffer, format="webp", quality=_QUALITY, method=_EFFORT)
    return buffer.getvalue()
