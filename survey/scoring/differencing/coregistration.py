"""Co-register two elevation models on unchanged ground: shift (Nuth and Kääb 2011), tilt, and bias by curvature."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple

import numpy as np
from scipy.linalg import eigh
from scipy.ndimage import gaussian_filter

from survey.core import BoolArray, FloatArray, InputError, same_crs, same_vertical_datum
from survey.data.dem import Dem
from survey.scoring.accuracy import NMAD_FACTOR

_N_ROUNDS = 30
_CONVERGED_CELLS = 1e-4
_N_LEAST = 50
# Differences farther than this from the median, in robust deviations, take no part.
_TRIMMED = 3.0
# Least spread of the slopes [m/m], also of their change over a cell: what does not vary is unobservable.
_LEAST_SLOPE_SPREAD = 1e-3
# Least share of it that both surfaces have in common: slopes and curvatures of errors are not fitted.
_LEAST_COMMON = 0.3
# Both are judged on surfaces smoothed over this many cells, and so is the curvature that is fitted.
_SMOOTHED_CELLS = 2.0
# Curvatures beyond these percentiles of the unchanged ground are taken for those.
_CURVATURE_LIMITS = (1.0, 99.0)
TERMS: tuple[str, ...] = (
    "east_m", "north_m", "up_m", "tilt_east_m_per_km", "tilt_north_m_per_km", "curvature_bias_m2",
)  # fmt: skip
"""Names of the terms of an alignment, in the order of the columns of its design."""


@dataclass(frozen=True)
class SurveyAlignment:
    r"""Corrections that align a surface with another one.

    .. math::  z(x) \rightarrow z(x - s) + s_z + t \cdot (x - x_0) + b \, \nabla^2 z

    `east_m`, `north_m`, `up_m`: shift, added to the coordinates, in the CRS of the surfaces [m]. `tilt_east_m_per_km`,
    `tilt_north_m_per_km`: tilt about the middle of the unchanged ground. `curvature_bias_m2`: height per curvature, as
    surfaces of different resolution have it (Gardelle et al. 2012) [m per 1/m]. `n`: cells of unchanged ground in the fit.
    `nmad_before_m`, `nmad_after_m`: spread of the difference there [m]. `std`: standard deviations of the terms by name,
    with the correlation of the errors; empty where it is not known. `left_out`: terms that the ground does not determine.
    """

    east_m: float
    north_m: float
    up_m: float
    n: int
    nmad_before_m: float
    nmad_after_m: float
    tilt_east_m_per_km: float = 0.0
    tilt_north_m_per_km: float = 0.0
    curvature_bias_m2: float = 0.0
    std: Mapping[str, float] = field(default_factory=dict)
    left_out: tuple[str, ...] = ()


class Aligned(NamedTuple):
    """Heights (H, W) of a surface on the cells of the reference after an alignment, and that.

    `columns` (K, H, W): how each of its `terms` (K,) changes the difference.
    """

    heights: FloatArray
    alignment: SurveyAlignment
    columns: FloatArray
    terms: tuple[str, ...]


def align(
    moving: Dem,
    reference: Dem,
    stable: BoolArray | None = None,
    weights: FloatArray | None = None,
    *,
    only_shift: bool = False,
) -> Aligned:
    r"""Align a surface with a reference by a shift, a tilt and a bias that grows with the curvature.

    .. math::  z_{ref}(x) - z(x - s) - s_z \approx s \cdot \nabla z(x), \qquad
               \text{or}\quad dh / \tan\beta = a \cos(b - \psi) + c

    Nuth and Kääb (2011, The Cryosphere 5, 271–290) write it with slope β and aspect ψ; here
    the same plane in the slopes is fitted by least squares together with the other terms, differences beyond three robust
    deviations trimmed, and repeated until the shift converges. A term that the unchanged ground does not determine, as a
    horizontal shift of flat ground, is left out and named.

    `stable` (H, W) bool: the reference's cells that did not change; all by default. `weights` (H, W): of the squared
    differences; equal by default. `only_shift`: without tilt and bias.

    One alignment for the whole raster: no scale, no jitter of a sensor.

    >>> from survey.data.grid import Grid
    >>> x, y = np.meshgrid(np.arange(41.0), np.arange(41.0))
    >>> def hills(east, north):
    ...     return 9.0 * np.sin((x - east) / 6.0) + 7.0 * np.cos((40.0 - y - north) / 5.0)
    >>> grid = Grid((0.0, 0.0, 40.0, 40.0), 1.0)
    >>> surfaces = Dem.on(grid, hills(0.0, 0.0)), Dem.on(grid, hills(1.5, -0.5) + 2.0)
    >>> shift = align(*surfaces, only_shift=True).alignment
    >>> round(shift.east_m, 1), round(shift.north_m, 1), round(shift.up_m, 1)
    (1.5, -0.5, 2.0)
    """
    fit = _Fit(moving, reference, stable, weights)
    fit.converge()
    if not only_shift:
        fit.add_biases()
        fit.converge()
    left_out = tuple(name for name in (TERMS[:3] if only_shift else TERMS) if name not in fit.terms)
    return Aligned(fit.heights(), replace(fit.alignment(), left_out=left_out), fit.columns, fit.terms)


class _Fit:
    """Least squares on the unchanged ground; `values` are the terms, of which the shift is updated, the others replaced."""

    def __init__(
        self, moving: Dem, reference: Dem, stable: BoolArray | None, weights: FloatArray | None = None
    ) -> None:
        same_crs(moving.crs, reference.crs, "the two elevation models")
        same_vertical_datum(moving.vertical_datum, reference.vertical_datum, "the two elevation models")
        self.moving, self.reference = moving, reference
        self.stable = np.isfinite(reference.elevation) & (True if stable is None else stable)
        self.root = np.ones(reference.shape) if weights is None else np.sqrt(weights)
        to_east, to_north = reference.gradient()
        self.values: dict[str, Any] = dict.fromkeys(TERMS, 0.0)
        self.n = 0
        self.before = self._moved()[self.stable]
        level = np.ones(reference.shape)
        self.sees_shift = self._is_common(lambda smooth: [*np.gradient(smooth, reference.step_m)])
        if self.sees_shift:
            self.columns: FloatArray = np.stack([-to_east, -to_north, level])
            self.terms = TERMS[:3]
        else:
            self.columns, self.terms = level[None], TERMS[2:3]

    def _moved(self) -> FloatArray:
        """Return the moving surface (H, W) on the cells of the reference after the horizontal shift."""
        xy = self.reference.xy - (self.values["east_m"], self.values["north_m"])
        return self.moving.at(xy).reshape(self.reference.shape)

    def _corrections(self) -> FloatArray:
        """Return what is added to the shifted surface (H, W): level, tilt and bias by curvature."""
        total = np.zeros(self.reference.shape)
        for name, column in zip(self.terms, self.columns, strict=True):
            if name not in TERMS[:2]:
                total += self.values[name] * column
        return total

    def heights(self) -> FloatArray:
        """Return the aligned surface (H, W) on the cells of the reference [m]."""
        return self._moved() + self._corrections()

    def converge(self) -> None:
        """Repeat until the horizontal shift stays."""
        for _ in range(_N_ROUNDS):
            step = self._step()
            if np.abs(step).max() < _CONVERGED_CELLS * self.reference.step_m:
                break

    def _step(self) -> FloatArray:
        """Solve for the terms once; returns how far the surface was shifted to the east and to the north."""
        moved = self.reference.elevation - self._moved()
        rest = moved - self._corrections()
        used = self.stable & np.isfinite(rest) & np.isfinite(self.columns).all(axis=0)
        if used.sum() < _N_LEAST:
            raise InputError(
                f"{int(used.sum())} cells of unchanged ground are common to both elevation models; {_N_LEAST} are needed to align them, "
                "name more of it or leave the alignment out."
            )
        far = np.abs(rest - np.median(rest[used]))
        used &= far <= _TRIMMED * max(_nmad(rest[used]), 1e-9)
        root = self.root[used]
        solution = np.linalg.lstsq((self.columns[:, used] * root).T, moved[used] * root, rcond=None)[0]
        found = dict(zip(self.terms, solution.tolist(), strict=True))
        step = np.array([found.pop(name, 0.0) for name in TERMS[:2]])
        self.values |= found | {
            name: self.values[name] + d for name, d in zip(TERMS[:2], step.tolist(), strict=True)
        }
        self.n = int(used.sum())
        return step

    def add_biases(self) -> None:
        """Add the columns of tilt, and of curvature where it varies."""
        x, y = (
            np.broadcast_to(axis, self.reference.shape)
            for axis in (self.reference.x[None], self.reference.y[:, None])
        )
        added = [(0.001 * (a - a[self.stable].mean())) for a in (x, y)]
        names = TERMS[3:5]
        if self._is_common(lambda smooth: [self._curvature(smooth) * self.reference.step_m]):
            both = [self._curvature(smooth) for smooth in self._both_smoothed()]
            seen = 0.5 * (both[0] + both[1])
            limits = np.nanpercentile(seen[self.stable], _CURVATURE_LIMITS)
            added, names = [*added, np.clip(seen, *limits)], TERMS[3:]
        self.columns = np.concatenate([self.columns, np.stack(added)])
        self.terms = (*self.terms, *names)

    def _curvature(self, smooth: FloatArray) -> FloatArray:
        """Return the Laplacian (H, W) of a surface [1/m]; 0 where it is not known."""
        second = [np.gradient(np.gradient(smooth, axis=axis), axis=axis) for axis in (0, 1)]
        curvature: FloatArray = np.nan_to_num((second[0] + second[1]) / self.reference.step_m**2)
        return curvature

    def _both_smoothed(self) -> list[FloatArray]:
        """Return the reference and the moving surface (H, W), smoothed; NaN about voids."""
        return [_smoothed(surface) for surface in (self.reference.elevation, self._moved())]

    def _is_common(self, derivatives: Callable[[FloatArray], Sequence[FloatArray]]) -> bool:
        """Return whether K derivatives (K, H, W) vary, and vary alike in both surfaces: those of their errors do not."""
        found = [np.stack([*derivatives(smooth)]) for smooth in self._both_smoothed()]
        used = self.stable & np.isfinite(found[0] + found[1]).all(axis=0)
        if used.sum() < _N_LEAST:
            return False
        one, other = (part[:, used] - part[:, used].mean(axis=1, keepdims=True) for part in found)
        common = one @ other.T / used.sum()
        spread = (one @ one.T + other @ other.T) / (2.0 * used.sum())
        if np.linalg.eigvalsh(spread)[0] < _LEAST_SLOPE_SPREAD**2:
            return False
        return bool(eigh(0.5 * (common + common.T), spread, eigvals_only=True)[0] >= _LEAST_COMMON)

    def alignment(self) -> SurveyAlignment:
        """Return the terms, and the spread of the difference before and after."""
        reference = self.reference.elevation
        before, after = (
            _nmad(reference[self.stable] - heights) for heights in (self.before, self.heights()[self.stable])
        )
        return SurveyAlignment(n=self.n, nmad_before_m=before, nmad_after_m=after, **self.values)


def _smoothed(surface: FloatArray) -> FloatArray:
    """Return a surface (H, W) smoothed where all cells about it are known, so that planes stay planes; NaN elsewhere."""
    known = np.isfinite(surface)
    level = float(surface[known].mean()) if known.any() else 0.0
    heights, shares = (
        gaussian_filter(part, _SMOOTHED_CELLS, mode="constant", truncate=2.0)
        for part in (np.where(known, surface - level, 0.0), known.astype(np.float64))
    )
    smooth: FloatArray = np.where(shares > 1.0 - 1e-9, heights, np.nan)
    return smooth


def _nmad(values: FloatArray) -> float:
    e = values[np.isfinite(values)]
    return float(NMAD_FACTOR * np.median(np.abs(e - np.median(e)))) if len(e) else float("nan")
