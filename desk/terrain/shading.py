"""Colours of terrain: hypsometric tints under a hillshade, slope, contours."""

import math
from dataclasses import dataclass
from typing import Self

import numpy as np
import numpy.typing as npt

from desk.terrain.palette import ELEVATION, SLOPE, colour_of
from desk.terrain.pyramid import ElevationPyramid
from survey.core.arrays import FloatArray
from survey.core.quantity_text import round_number

Pixels = npt.NDArray[np.uint8]

LARGEST_SLOPE_DEG = 45.0
"""Slope at the upper end of its colours [deg]."""
_LIGHT = np.array([-0.5, 0.5, math.sqrt(0.5)])  # from the north-west, 45° above the horizon
_SHADE_STRENGTH = 0.75


@dataclass(frozen=True)
class TerrainStyle:
    """What all tiles of a terrain have in common.

    Parameters
    ----------
    low_m, high_m : float
        Heights at both ends of the colours [m].
    exaggeration : float
        Factor of the slopes under the hillshade.
    interval_m : float
        Height between contours [m].
    """

    low_m: float
    high_m: float
    exaggeration: float
    interval_m: float

    @classmethod
    def of(cls, pyramid: ElevationPyramid) -> Self:
        """Choose colours and exaggeration from a coarse level.

        Parameters
        ----------
        pyramid : ElevationPyramid
            The terrain.

        Returns
        -------
        TerrainStyle
            The same for every tile.
        """
        heights = pyramid.level(max(pyramid.base, pyramid.coarsest))
        known = heights[np.isfinite(heights)]
        low, high = (float(known.min()), float(known.max())) if len(known) else (0.0, 1.0)
        relief = max(high - low, 1e-3)
        cell_m = pyramid.step_m * 2 ** max(pyramid.base, pyramid.coarsest)
        return cls(low, low + relief, _exaggeration(heights, cell_m), round_number(relief / 25.0))

    def relief(self, heights: FloatArray, cell_m: float) -> Pixels:
        """Return tints under a hillshade.

        Parameters
        ----------
        heights : (H + 2, W + 2) ndarray
            With one more cell to each side [m].
        cell_m : float
            Width of a cell [m].

        Returns
        -------
        (H, W, 4) ndarray of uint8
            Transparent where no height is known.
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

        Parameters
        ----------
        heights, cell_m
            As for `relief`.

        Returns
        -------
        (H, W, 4) ndarray of uint8
            Transparent where the slope is not known.
        """
        slope_deg = np.degrees(np.arctan(np.hypot(*_gradient(heights, cell_m))))
        known = np.isfinite(heights[1:-1, 1:-1])
        share = np.where(known, slope_deg / LARGEST_SLOPE_DEG, 0.0)
        return _with_alpha(colour_of(SLOPE, share), known)

    def contours(self, heights: FloatArray, cell_m: float) -> Pixels:
        """Return dark pixels where the height passes a multiple of the interval; every fifth one is strong.

        Parameters
        ----------
        heights, cell_m
            As for `relief`.

        Returns
        -------
        (H, W, 4) ndarray of uint8
            Transparent elsewhere.
        """
        del cell_m
        alpha = np.zeros(tuple(side - 2 for side in heights.shape))
        for n, strength in ((1, 110.0), (5, 210.0)):
            band = np.floor(heights / (n * self.interval_m))
            here, east, south = band[1:-1, 1:-1], band[1:-1, 2:], band[2:, 1:-1]
            crossed = ((here != east) & np.isfinite(east)) | ((here != south) & np.isfinite(south))
            alpha[crossed & np.isfinite(here)] = strength
        pixels = np.zeros((*alpha.shape, 4), dtype=np.uint8)
        pixels[..., :3], pixels[..., 3] = (40, 52, 64), alpha
        return pixels


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
    return float(np.clip(math.tan(math.radians(30.0)) / max(typical, 1e-6), 1.0, 10.0))
