"""Colours of terrain: palettes of heights, slopes and deviations, and shaded relief."""

import io
import math
from dataclasses import dataclass
from typing import Self

import numpy as np
import numpy.typing as npt
from PIL import Image

from desk.terrain.pyramid import ElevationPyramid
from survey.core import Bounds, ConfigError, FloatArray, round_number

Table = npt.NDArray[np.uint8]


def _table(colours: str) -> Table:
    """Return 256 colours (256, 3) between those that are named as hexadecimal numbers."""
    named = np.array([list(bytes.fromhex(colour)) for colour in colours.split()], dtype=np.float64)
    places, share = np.linspace(0.0, 1.0, len(named)), np.linspace(0.0, 1.0, 256)
    table = np.stack([np.interp(share, places, channel) for channel in named.T], axis=1)
    return table.round().astype(np.uint8)


ELEVATION = _table(
    "47739d 517b9c 5a829a 638897 6c8e93 75948f 7f9a8b 8aa288 95aa87 a3b489 b4c190 c7d09c d9dfad e7eabe f2f2d0 f8f8e1 fcfcf0"
)
"""Ice: from low to high ground."""
DEVIATION = _table(
    "fffecb fdf2a8 f8e07f f4cd61 efb956 eba853 e89852 e58851 e17750 dc674e d0554c b94a48 9e4442 813c37 67342a 512d1e 3f2615"
)
"""Standard deviations: from certain to uncertain."""
SLOPE = _table(
    "fffecb fcef9f f7d971 f1c159 ecac54 e99a52 e58751 e1744f d85f4d c44e4a a44544 833d38 653329 4b2b1b 362411 261e08 191900"
)
"""From level to steep ground."""
ERROR = _table(
    "001261 022b71 034481 0c5e92 307da6 619ebd 94bed2 c6dbe6 ece5e0 e9cab8 dbaa8d cf8c66 c27041 b2511d 912d06 731406 590008"
)
"""From too low to too high, about zero."""
SUPPORT = _table("5b2a86 d8b365 9ecae1 2b8cbe")
"""Unseen, interpolated, bounded by a line of sight, measured."""


def colour_of(table: Table, share: npt.NDArray[np.float64]) -> Table:
    """Return the colours of shares; those beyond 0 and 1 have the colours of the ends.

    `table` (256, 3): one of the tables of this module.

    >>> bool((colour_of(SLOPE, np.array([0.0, 7.0])) == SLOPE[[0, 255]]).all())
    True
    """
    return table[np.clip(share * 255.0, 0, 255).astype(np.uint8)]


def legend_colours(table: Table, n: int = 8) -> list[str]:
    """Return equally spaced colours of a table for a legend, such as ``#0b3d5c``."""
    rows = table[np.linspace(0, 255, n).astype(int)].tolist()
    return [f"#{red:02x}{green:02x}{blue:02x}" for red, green, blue in rows]


_ROUND = (1.0, 1.2, 1.5, 2.0, 2.5, 3.0, 4.0, 5.0, 6.0, 8.0, 10.0)


def colour_limit(values: npt.NDArray[np.float64]) -> float:
    """Return a round number that at most 2 % of the sizes of some values are above; NaN counts as no value.

    >>> colour_limit(np.array([0.19, -0.18, np.nan]))
    0.2
    """
    top = max(float(np.nanpercentile(np.abs(values), 98.0)), 1e-3)
    power = 10.0 ** math.floor(math.log10(top))
    return float(f"{next(factor for factor in _ROUND if factor * power >= top) * power:.2g}")


Pixels = npt.NDArray[np.uint8]


def encode_png(pixels: Pixels) -> bytes:
    """Return an image as PNG.

    `pixels` (H, W, 4): red, green, blue, opacity.
    """
    buffer = io.BytesIO()
    Image.fromarray(pixels, "RGBA").save(buffer, "PNG", compress_level=1)
    return buffer.getvalue()


LARGEST_SLOPE_DEG = 45.0
"""Slope at the upper end of its colours [deg]."""
_LIGHT = np.array([-0.5, 0.5, math.sqrt(0.5)])  # from the north-west, 45° above the horizon
_SHADE_STRENGTH = 0.85
_OVERVIEW_CELLS = 100_000
_LARGEST_HEIGHT_M = 1e5
_MOST_EXAGGERATION = 10.0
_LEAST_OVERLAP = 0.6


@dataclass(frozen=True)
class TerrainStyle:
    """Colours of elevations and strength of the hillshade, chosen for the ground that is looked at.

    `low_m`, `high_m`: heights at both ends of the colours [m]. `exaggeration`: factor of the slopes under the
    hillshade.

    >>> TerrainStyle.parsed("700,900,2.5")
    TerrainStyle(low_m=700.0, high_m=900.0, exaggeration=2.5)
    """

    low_m: float
    high_m: float
    exaggeration: float

    def __post_init__(self) -> None:
        in_order = -_LARGEST_HEIGHT_M < self.low_m < self.high_m < _LARGEST_HEIGHT_M
        if not (in_order and 1.0 <= self.exaggeration <= _MOST_EXAGGERATION):
            raise ConfigError(f"the colours {self.text!r} are not known; reload the page.")

    @classmethod
    def parsed(cls, text: str) -> Self:
        """Read what `text` writes."""
        try:
            low, high, factor = (float(part) for part in text.split(","))
        except ValueError as error:
            raise ConfigError(f"the colours {text[:40]!r} are not known; reload the page.") from error
        return cls(low, high, factor)

    @classmethod
    def of(cls, pyramid: ElevationPyramid, bounds: Bounds) -> Self:
        """Stretch the colours over the heights within bounds.

        `bounds`: ``(xmin, ymin, xmax, ymax)`` [m].
        """
        part = pyramid.over(bounds, _OVERVIEW_CELLS)
        known = part.heights[np.isfinite(part.heights)]
        low, high = np.percentile(known, [0.5, 99.5]).tolist() if len(known) else (0.0, 1.0)
        step = round_number(max(high - low, 0.01) / 8.0)
        low, high = math.floor(low / step) * step, math.ceil(high / step) * step
        factor = _exaggeration(part.heights, part.cell_m)
        return cls(round(low, 6), round(max(high, low + step), 6), round(factor, 1))

    @property
    def text(self) -> str:
        """The style as a part of an address."""
        return f"{self.low_m:.10g},{self.high_m:.10g},{self.exaggeration:g}"

    def still_fits(self, other: "TerrainStyle") -> bool:
        """Return whether tiles of this style can stay where another one would be chosen."""
        span = self.high_m - self.low_m
        overlap = min(self.high_m, other.high_m) - max(self.low_m, other.low_m)
        is_alike = overlap > _LEAST_OVERLAP * max(span, other.high_m - other.low_m)
        return is_alike and 0.7 < self.exaggeration / other.exaggeration < 1.4

    def relief(self, heights: FloatArray, cell_m: float) -> Pixels:
        """Return tints under a hillshade.

        `heights` (H + 2, W + 2): with one more cell to each side [m]. `cell_m`: width of a cell [m]. Returns
        (H, W, 4): transparent where no height is known.
        """
        inner = heights[1:-1, 1:-1]
        known = np.isfinite(inner)
        share = np.where(known, (inner - self.low_m) / (self.high_m - self.low_m), 0.0)
        tints = colour_of(ELEVATION, share).astype(np.float64)
        shade = _hillshade(heights, cell_m, self.exaggeration)[..., None]
        lit = tints * np.minimum(shade, 1.0) + (255.0 - tints) * np.clip(shade - 1.0, 0.0, 1.0)
        return _with_alpha(lit, known)

    def slope(self, heights: FloatArray, cell_m: float) -> Pixels:
        """Return the colours of the steepest slope, up to `LARGEST_SLOPE_DEG`.

        Returns (H, W, 4): transparent where the slope is not known.
        """
        slope_deg = np.degrees(np.arctan(np.hypot(*_gradient(heights, cell_m))))
        known = np.isfinite(heights[1:-1, 1:-1])
        share = np.where(known, slope_deg / LARGEST_SLOPE_DEG, 0.0)
        return _with_alpha(colour_of(SLOPE, share), known)


def _with_alpha(colours: npt.NDArray[np.floating] | Pixels, known: npt.NDArray[np.bool_]) -> Pixels:
    pixels = np.zeros((*known.shape, 4), dtype=np.uint8)
    pixels[..., :3] = np.clip(colours, 0, 255)
    pixels[..., 3] = np.where(known, 255, 0)
    return pixels


def _gradient(heights: FloatArray, cell_m: float) -> tuple[FloatArray, FloatArray]:
    """Compute the gradient to the east and north by central differences; one-sided beside unknown heights."""
    inner = heights[1:-1, 1:-1]
    west, east, north, south = heights[1:-1, :-2], heights[1:-1, 2:], heights[:-2, 1:-1], heights[2:, 1:-1]
    return _rise(west, inner, east, cell_m), _rise(south, inner, north, cell_m)


def _rise(before: FloatArray, here: FloatArray, after: FloatArray, cell_m: float) -> FloatArray:
    has_before, has_after = np.isfinite(before), np.isfinite(after)
    low, high = np.where(has_before, before, here), np.where(has_after, after, here)
    n_cells = has_before.astype(np.float64) + has_after
    return np.where(n_cells > 0, (high - low) / (np.maximum(n_cells, 1) * cell_m), 0.0)


def _hillshade(heights: FloatArray, cell_m: float, exaggeration: float) -> FloatArray:
    """Brightness relative to level ground: below 1 in shadow, above 1 in light."""
    to_east, to_north = (exaggeration * rise for rise in _gradient(heights, cell_m))
    facing = (_LIGHT[2] - _LIGHT[0] * to_east - _LIGHT[1] * to_north) / np.sqrt(1 + to_east**2 + to_north**2)
    shade = 1.0 + _SHADE_STRENGTH * (np.clip(facing, 0.0, 1.0) - _LIGHT[2]) / _LIGHT[2]
    return np.where(np.isfinite(shade), shade, 1.0)


def _exaggeration(heights: FloatArray, cell_m: float) -> float:
    """Return the factor that makes gentle terrain readable; steep ground stays as it is."""
    steepness = np.hypot(*_gradient(np.pad(heights, 1, constant_values=np.nan), cell_m))
    known = steepness[np.isfinite(heights)]
    typical = float(np.percentile(known, 90.0)) if len(known) else 0.0
    return float(np.clip(math.tan(math.radians(30.0)) / max(typical, 1e-6), 1.0, _MOST_EXAGGERATION))
