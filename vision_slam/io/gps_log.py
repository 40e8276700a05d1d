"""Fixes of a satellite receiver as its file has them, and their way into a projected CRS."""

import logging
from dataclasses import dataclass, replace

import numpy as np
from pyproj import CRS

from survey.core.arrays import FloatArray
from survey.core.crs.checks import projected_crs
from survey.core.crs.choice import chosen_crs
from survey.core.crs.transformation import transformed
from survey.core.crs.vertical_datum import UNSTATED
from survey.core.errors import ConfigError, InputError
from survey.data.sensors.aiding import GpsFixes

WGS84 = CRS.from_epsg(4326)
logger = logging.getLogger(__name__)
_NEAR = 0.015  # 100 km over the radius of the Earth


@dataclass(frozen=True)
class GpsLog:
    """Fixes of a receiver as its file has them.

    Parameters
    ----------
    time_s : (N,) ndarray
        Times of the fixes [s]: Unix time when `is_dated`, else as the file counts.
    place : (N, 3) ndarray
        Longitude, latitude [deg] and height [m] where `is_geodetic`, else easting, northing
        and height [m] in a CRS that the file does not name.
    is_geodetic, is_dated : bool
        See above.
    n_without_fix : int
        Records that the receiver itself marked as no fix; they are left out.
    vertical_datum : str
        What heights count from; ``""`` when the file does not state it.
    sigma_m : (N,) ndarray, optional
        Horizontal standard deviation of each fix [m], where the file states it or its quality.
    notes : tuple of str
        What the reader chose or left out, one sentence each.
    """

    time_s: FloatArray
    place: FloatArray
    is_geodetic: bool = True
    is_dated: bool = False
    n_without_fix: int = 0
    vertical_datum: str = UNSTATED
    sigma_m: FloatArray | None = None
    notes: tuple[str, ...] = ()

    @property
    def utm(self) -> CRS | None:
        """The UTM zone of the first fix near the others, polar stereographic near the poles; None where the file has metres."""
        if not self.is_geodetic:
            return None
        longitude, latitude = self.place[_first_near(self.place)][:2, None]
        return chosen_crs(longitude, latitude)

    def fixes(self, crs: CRS | str | None = None) -> tuple[GpsFixes, CRS]:
        """Return the fixes in a projected CRS, and which one that is: the UTM zone of the first fix unless named.

        Parameters
        ----------
        crs : str or pyproj.CRS, optional
            Projected CRS; needed for files in metres.

        Returns
        -------
        fixes : GpsFixes
            Positions in the CRS [m].
        crs : pyproj.CRS
            The working CRS.

        Raises
        ------
        ConfigError
            The file has metres, and no CRS is named.
        InputError
            Fewer than two fixes, times that do not increase, or places beyond the CRS.

        Examples
        --------
        >>> log = GpsLog(np.array([0.0, 1.0]), np.array([[-135.0, 58.4, 5.0], [-135.0, 58.5, 5.0]]))
        >>> log.fixes()[1].to_epsg()
        32608
        """
        if crs is None and self.utm is None:
            raise ConfigError("the fixes are in metres, and the file names no CRS; name one with --crs.")
        target = projected_crs(self.utm if crs is None else crs, "the fixes")
        if not self.is_geodetic:
            return GpsFixes(self.time_s, self.place, self.sigma_m), target
        xy = transformed(self.place[:, :2], WGS84, target, "the fixes")
        return GpsFixes(self.time_s, np.column_stack([xy, self.place[:, 2]]), self.sigma_m), target

    def without_zero_places(self, where: str) -> "GpsLog":
        """Leave out fixes at longitude and latitude 0, which receivers write before they have a fix; note how many.

        Parameters
        ----------
        where : str
            What the fixes were read from, for messages.

        Returns
        -------
        GpsLog
            The same log where no fix is at exactly 0, 0; places in metres stay as they are.

        Raises
        ------
        InputError
            All fixes are there.

        Examples
        --------
        >>> log = GpsLog(np.arange(3.0), np.array([[0.0, 0.0, 0.0], [8.1, 46.5, 5.0], [8.2, 46.5, 5.0]]))
        >>> len(log.without_zero_places("log.csv").time_s)
        2
        """
        is_zero = self.is_geodetic & (self.place[:, :2] == 0.0).all(axis=1)
        n = int(is_zero.sum())
        if n == 0:
            return self
        if n == len(is_zero):
            raise InputError(
                f"{where} holds {n} fixes, all at longitude and latitude 0, as receivers write them before they have a fix; "
                "record again once there is one."
            )
        note = f"{n} fixes at longitude and latitude 0 are left out"
        logger.info("%s: %s", where, note)
        return replace(
            self,
            time_s=self.time_s[~is_zero],
            place=self.place[~is_zero],
            sigma_m=None if self.sigma_m is None else self.sigma_m[~is_zero],
            notes=(*self.notes, note),
        )


def _first_near(place: FloatArray) -> int:
    """Return the number of the first fix within 100 km of the median of all; 0 where none is."""
    longitude, latitude = np.radians(place[:, 0]), np.radians(place[:, 1])
    flat = np.cos(latitude)
    upward = np.column_stack([flat * np.cos(longitude), flat * np.sin(longitude), np.sin(latitude)])
    return int(np.argmax(np.linalg.norm(upward - np.median(upward, axis=0), axis=1) < _NEAR))
