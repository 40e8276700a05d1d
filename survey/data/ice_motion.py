"""Motion of a glacier's surface during a survey: velocity and lowering as smooth fields, with their covariance.

`IceMotion` has a constant velocity and a constant rate of lowering, each a constant or a plane, and a linear model of their
errors. It is written as a JSON document.
"""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Self

import numpy as np

from survey.core import DataObject, FloatArray, InputError, checked, read_json, write_json

DAY_S = 86400.0
"""Seconds of a day."""
_KM = 1000.0
# Passes of the fixed point x₀ = x − v(x₀) (t − t₀): each reduces the error by the strain, some 1 %.
_PASSES = 4
# Directions with a smaller share of the largest variance count as exact.
_LEAST_SHARE = 1e-14


@dataclass(frozen=True, eq=False, repr=False)
class IceMotion(DataObject):
    r"""Gaussian estimate of the motion of a surface that flows and lowers.

    .. math::  z(x, t) = z_0(x - v (t - t_0)) - a (t - t_0)

    with z₀ the surface at the epoch t₀, v the horizontal velocity and a the rate of lowering. Both are constant in time;
    each component is a constant, or a constant and a plane. The errors of the coefficients are linear functions of
    independent unknowns.

    Parameters
    ----------
    coefficients : (3, M) array_like
        Of velocity to the east, to the north, and of lowering [m/day]: the value at `origin_m`, then the changes per
        kilometre to the east and to the north. M is 1 or 3.
    epoch_s : float
        Time t₀ in seconds of the recording.
    origin_m : (2,) array_like
        Easting and northing that the planes count from [m].
    modes : (3 M, R) array_like
        Change of the coefficients, row by row, for unknowns of 1. Without columns the motion is exact.
    spread : (R, R) array_like, optional
        Covariance of the unknowns; the identity by default.
    expected : (R,) array_like, optional
        Mean of the unknowns, where the coefficients are not the most likely ones; 0 by default.

    Notes
    -----
    It has no change of velocity in time and no rotation beyond that of the planes. Lowering is that of the surface at
    points that move with the ice: melt, less the rise of the ice itself.

    Examples
    --------
    >>> motion = IceMotion(np.array([[2.0], [0.0], [0.1]]), 0.0, np.zeros(2), np.eye(3))
    >>> motion.displacement(np.zeros((1, 2)), np.array([43200.0])).tolist()
    [[1.0, 0.0, -0.05]]
    """

    coefficients: FloatArray
    epoch_s: float
    origin_m: FloatArray
    modes: FloatArray
    spread: Any = None
    expected: Any = None

    def __post_init__(self) -> None:
        shape = np.shape(self.coefficients)
        if shape not in ((3, 1), (3, 3)):
            raise InputError(
                f"the motion of the ice has coefficients of shape {shape}; give (3, 1) or (3, 3)."
            )
        object.__setattr__(self, "coefficients", checked(self.coefficients, shape, "the motion of the ice"))
        modes = checked(self.modes, (3 * shape[1], None), "the modes of the ice's motion")
        spread = np.eye(modes.shape[1]) if self.spread is None else self.spread
        n = modes.shape[1]
        object.__setattr__(self, "modes", modes)
        object.__setattr__(self, "spread", checked(spread, (n, n), "the covariance of the ice's motion"))
        expected = np.zeros(n) if self.expected is None else self.expected
        object.__setattr__(self, "expected", checked(expected, (n,), "the expected motion of the ice"))
        object.__setattr__(self, "origin_m", checked(self.origin_m, (2,), "the origin of the ice's motion"))
        if not np.isfinite(self.epoch_s):
            raise InputError(f"the epoch is {self.epoch_s}; give a time in seconds of the recording.")

    @classmethod
    def of(
        cls, coefficients: FloatArray, covariance: FloatArray, *, epoch_s: float, origin_m: FloatArray
    ) -> Self:
        """Build a motion from coefficients (3, M) and their covariance (3 M, 3 M), which may be singular.

        Parameters
        ----------
        coefficients : (3, M) ndarray
            As in `IceMotion`.
        covariance : (3 M, 3 M) ndarray
            Of the coefficients, row by row.
        epoch_s : float
            Epoch [s].
        origin_m : (2,) ndarray
            Origin of the planes [m].

        Returns
        -------
        IceMotion
            With one unknown for each direction of positive variance.
        """
        value, vector = np.linalg.eigh(0.5 * (covariance + covariance.T))
        free = value > _LEAST_SHARE * max(float(value.max(initial=0.0)), 1e-300)
        return cls(coefficients, epoch_s, origin_m, vector[:, free] * np.sqrt(value[free]))

    @property
    def n_unknowns(self) -> int:
        """Number of unknowns R."""
        return int(self.modes.shape[1])

    @property
    def covariance(self) -> FloatArray:
        """Covariance (3 M, 3 M) of the coefficients, row by row."""
        covariance: FloatArray = self.modes @ self.spread @ self.modes.T
        return covariance

    def rates(self, xy: FloatArray) -> FloatArray:
        """Return velocity east and north and the rise of the surface (N, 3) [m/day] at places of the epoch.

        Parameters
        ----------
        xy : (N, 2) ndarray
            Easting and northing at the epoch [m].

        Returns
        -------
        (N, 3) ndarray
            The rise is negative where the surface lowers.
        """
        rates: FloatArray = self._basis(xy) @ self.coefficients.T * _SIGN
        return rates

    def rates_sigma(self, xy: FloatArray) -> FloatArray:
        """Return the standard deviations (N, 3) of the rates [m/day].

        Parameters
        ----------
        xy : (N, 2) ndarray
            Easting and northing at the epoch [m].

        Returns
        -------
        (N, 3) ndarray
            Of velocity east and north, and of lowering.
        """
        by = self._rates_by_unknowns(xy)
        sigma: FloatArray = np.sqrt(np.einsum("nar,rs,nas->na", by, self.spread, by))
        return sigma

    def displacement(self, xy: FloatArray, time_s: FloatArray) -> FloatArray:
        """Return how far the surface at places of the epoch has moved by some times (N, 3) [m].

        Parameters
        ----------
        xy : (N, 2) ndarray
            Easting and northing at the epoch [m].
        time_s : (N,) ndarray
            Times [s].

        Returns
        -------
        (N, 3) ndarray
            East, north and up.
        """
        moved: FloatArray = self.rates(xy) * self._days(time_s)
        return moved

    def derivatives(self, xy: FloatArray, time_s: FloatArray) -> FloatArray:
        """Return the derivatives (N, 3, R) of the displacement by the unknowns [m].

        Parameters
        ----------
        xy, time_s : ndarray
            As in `displacement`.

        Returns
        -------
        (N, 3, R) ndarray
            Of east, north and up.
        """
        by: FloatArray = self._rates_by_unknowns(xy) * self._days(time_s)[:, :, None]
        return by

    def at_epoch(self, xyz: FloatArray, time_s: FloatArray) -> FloatArray:
        """Return the places (N, 3) [m] at the epoch of what is at some places at some times.

        Parameters
        ----------
        xyz : (N, 3) ndarray
            Easting, northing and elevation [m].
        time_s : (N,) ndarray
            Times [s].

        Returns
        -------
        (N, 3) ndarray
            Easting, northing and elevation at the epoch [m].
        """
        places: FloatArray = xyz - self.displacement(xyz[:, :2], time_s)
        if self.coefficients.shape[1] > 1:
            for _ in range(_PASSES):
                places = xyz - self.displacement(places[:, :2], time_s)
        return places

    def updated(self, shift: FloatArray, spread: FloatArray) -> Self:
        """Return the motion after data: unknowns of a mean (R,) and a covariance (R, R).

        Parameters
        ----------
        shift : (R,) ndarray
            Mean of the unknowns, counted from the present one.
        spread : (R, R) ndarray
            Their covariance.

        Returns
        -------
        IceMotion
            With the same modes.
        """
        coefficients = self.coefficients + (self.modes @ shift).reshape(self.coefficients.shape)
        return replace(
            self, coefficients=coefficients, spread=0.5 * (spread + spread.T), expected=np.zeros(len(shift))
        )

    def about(self, shift: FloatArray) -> Self:
        """Return the same estimate, written about other coefficients.

        Parameters
        ----------
        shift : (R,) ndarray
            Unknowns that the new coefficients have now.

        Returns
        -------
        IceMotion
            Of the same mean and covariance.
        """
        coefficients = self.coefficients + (self.modes @ shift).reshape(self.coefficients.shape)
        return replace(self, coefficients=coefficients, expected=self.expected - shift)

    def _basis(self, xy: FloatArray) -> FloatArray:
        """Return the values (N, M) of the constant and of the planes."""
        ones = np.ones((len(xy), 1))
        if self.coefficients.shape[1] == 1:
            return ones
        return np.hstack([ones, (xy - self.origin_m) / _KM])

    def _rates_by_unknowns(self, xy: FloatArray) -> FloatArray:
        """Return the derivatives (N, 3, R) of the rates by the unknowns [m/day]."""
        modes = self.modes.reshape(3, self.coefficients.shape[1], self.n_unknowns)
        by: FloatArray = np.einsum("nm,amr->nar", self._basis(xy), modes) * _SIGN[None, :, None]
        return by

    def _days(self, time_s: FloatArray) -> FloatArray:
        """Return times since the epoch (N, 1) [days]."""
        days: FloatArray = (np.asarray(time_s)[:, None] - self.epoch_s) / DAY_S
        return days


# Lowering is counted down, displacement up.
_SIGN = np.array([1.0, 1.0, -1.0])


ICE_MOTION = "ice_motion.json"
"""Name of the file beside a path or a map."""
_FORMAT = "firnline-ice-motion-1"


def write_motion(motion: IceMotion, path: str | Path) -> None:
    """Write a motion as a JSON document, with its rates at the origin."""
    at_origin = motion.origin_m[None]
    names = ("velocity_east", "velocity_north", "rise")
    rates, sigma = motion.rates(at_origin)[0].tolist(), motion.rates_sigma(at_origin)[0].tolist()
    content = {
        "format": _FORMAT,
        "epoch_s": motion.epoch_s,
        "origin_m": motion.origin_m.tolist(),
        **{f"{name}_m_per_day": value for name, value in zip(names, rates, strict=True)},
        **{f"{name}_sigma_m_per_day": value for name, value in zip(names, sigma, strict=True)},
        "coefficients": motion.coefficients.tolist(),
        "modes": motion.modes.tolist(),
        "spread": motion.spread.tolist(),
        "expected": motion.expected.tolist(),
    }
    write_json(path, content)


def read_motion(path: str | Path) -> IceMotion:
    """Read the document of `write_motion`."""
    content = read_json(path, "the motion of the ice")
    try:
        coefficients = np.array(content["coefficients"], dtype=np.float64)
        expected = np.array(content["expected"], dtype=np.float64)
        modes = np.array(content["modes"], dtype=np.float64).reshape(coefficients.size, len(expected))
        spread = np.array(content["spread"], dtype=np.float64).reshape(len(expected), len(expected))
        epoch_s, origin_m = float(content["epoch_s"]), np.array(content["origin_m"], dtype=np.float64)
    except (KeyError, TypeError, ValueError) as error:
        raise InputError(f"{path} is no motion of the ice ({error}); localize again.") from error
    return IceMotion(coefficients, epoch_s, origin_m, modes, spread, expected)
