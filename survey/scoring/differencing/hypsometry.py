r"""Mean change over outlines with voids, filled by the mean change at the same elevation.

The change of a glacier depends on elevation first of all. A void is therefore given the mean change of the mapped cells
of its elevation band: of the same glacier (local hypsometric mean), of all outlines where the glacier maps none of the
band (global hypsometric mean), and of the nearest band of the glacier where no outline maps any (McNabb et al. 2019, The
Cryosphere 13, 895–910). A mean is thus a weighted sum of mapped cells, through which their errors are propagated.
"""

from typing import NamedTuple

import numpy as np

from survey.core import BoolArray, FloatArray, IntArray

_WIDTH_M = 50.0
_LEAST_BANDS = 10
# A band with fewer mapped cells is filled from elsewhere.
_LEAST_CELLS = 5
# Band of cells that neither survey maps.
_UNKNOWN = np.iinfo(np.int64).min


class ElevationBand(NamedTuple):
    """Change in one elevation band of an outline.

    `low_m`, `high_m`: its limits [m]. `area_m2`: area on the ground [m²]. `known_share`: share of it that both surveys
    map. `mean_m`: mean change, filled where nothing is mapped [m]. `spread_m`: standard deviation of the change of the
    cells behind the mean [m].
    """

    low_m: float
    high_m: float
    area_m2: float
    known_share: float
    mean_m: float
    spread_m: float


class FilledMean(NamedTuple):
    """Weights (H, W) of the mapped cells in the mean of an outline; the deviation that its voids add [m]; its bands."""

    weights: FloatArray
    void_std_m: float
    bands: tuple[ElevationBand, ...]


def _width_m(relief_m: float) -> float:
    """Return a round width of elevation bands, of which a relief holds ten or more."""
    most = min(_WIDTH_M, max(relief_m / _LEAST_BANDS, 0.01))
    ten = 10.0 ** np.floor(np.log10(most))
    return float(ten * max(part for part in (1.0, 2.0, 5.0) if part * ten <= most * (1.0 + 1e-9)))


class Hypsometry:
    """Mapped cells of all outlines by elevation.

    `heights`, `difference` (H, W): height of the ground and its change [m]; NaN where unknown. `areas` (H, W): of the
    cells on the ground [m²]. `known` (H, W) bool: cells that both surveys map. `within` (H, W) bool: all outlines.
    """

    def __init__(
        self,
        heights: FloatArray,
        difference: FloatArray,
        areas: FloatArray,
        known: BoolArray,
        within: BoolArray,
    ) -> None:
        self.shape = difference.shape
        self.difference, self.areas, self.known = difference.ravel(), areas.ravel(), known.ravel()
        seen = heights[within & np.isfinite(heights)]
        self.width_m = _width_m(float(np.ptp(seen)) if seen.size else 0.0)
        index = np.floor(np.nan_to_num(heights) / self.width_m).astype(np.int64)
        self.band: IntArray = np.where(np.isfinite(heights), index, _UNKNOWN).ravel()
        self.pool = np.flatnonzero(known & within)

    def mean_over(self, inside: BoolArray, beyond_share: float) -> FilledMean:
        """Return the weights of the mean over the cells (H, W) of an outline.

        `beyond_share`: share of the outline beyond the rasters; it changes like the rest.
        """
        cells = np.flatnonzero(inside)
        mapped = cells[self.known[cells]]
        weights = np.zeros(self.difference.shape)
        weights[mapped] = self.areas[mapped]
        voids, bands = 0.0, []
        for band in np.unique(self.band[cells]):
            here = cells[self.band[cells] == band]
            own, void = here[self.known[here]], here[~self.known[here]]
            area_m2, void_m2 = float(self.areas[here].sum()), float(self.areas[void].sum())
            source = self._source(band, mapped) if void.size else own
            share = self.areas[source] / self.areas[source].sum()
            weights[source] += void_m2 * share
            spread_m = float(self.difference[source].std())
            # Voids change differently together, by as much as mapped cells of their band vary.
            voids += void_m2 * spread_m
            if band != _UNKNOWN:
                gained = self.areas[own] @ self.difference[own] + void_m2 * (share @ self.difference[source])
                limits = (float(band) * self.width_m, float(band + 1) * self.width_m)
                bands.append(
                    ElevationBand(
                        *limits, area_m2, 1.0 - void_m2 / area_m2, float(gained) / area_m2, spread_m
                    )
                )
        total = float(weights.sum())
        beyond_m = beyond_share * float(self.difference[mapped].std())
        void_std_m = (1.0 - beyond_share) * voids / total + beyond_m
        return FilledMean((weights / total).reshape(self.shape), void_std_m, tuple(bands))

    def _source(self, band: int, mapped: IntArray) -> IntArray:
        """Return the cells that stand for the voids of a band, of an outline with mapped cells."""
        if band == _UNKNOWN:
            return mapped
        for cells in (mapped, self.pool):
            found: IntArray = cells[self.band[cells] == band]
            if found.size >= _LEAST_CELLS:
                return found
        distance = np.abs(self.band[mapped] - band)
        nearest: IntArray = mapped[distance == distance.min()]
        return nearest
