"""Measured points of the terrain surface with their covariances.

`SurfacePoints` holds places (N, 3) in a projected CRS, their covariances, and the vertical datum. Point files of every
format become such points: places in degrees are projected, and the uncertainty is taken from six columns of the covariance
or one of the standard deviation.
"""

import logging
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

import numpy as np
import shapely
from pyproj import CRS

from survey.core import (
    UNSTATED,
    BoolArray,
    DataObject,
    FloatArray,
    InputError,
    ReadOnlyMapping,
    agreed_crs,
    checked,
    frozen,
    projected_crs,
    same_crs,
    same_vertical_datum,
)
from survey.core.crs import datum_of_file, is_local, known_crs, refuse_degrees, refuse_exchanged
from survey.core.transformation import chosen_crs, metric_crs, transformed
from survey.data.conversions import draw_points, drawing, html_table, to_geodataframe, value_range
from survey.data.ground_filter import filter_ground
from survey.io.point_classes import Ground, choose_points
from survey.io.point_files import read_point_table, write_point_table
from survey.io.point_table import PLACE, SIGMA, PointTable, log_projection, once_each

if TYPE_CHECKING:
    from geopandas import GeoDataFrame
    from matplotlib.axes import Axes


_BODY = ("body_x_m", "body_y_m", "body_z_m")
_RANGE = "range_m"
_KEYFRAME, _HEADING = "keyframe", "heading_rad"
_VALUE_SIGMA = "sigma_"


@dataclass(frozen=True, eq=False, repr=False)
class SurfacePoints(DataObject):
    """Points on the terrain with covariances.

    Parameters
    ----------
    xyz : (N, 3) array_like
        Easting, northing and elevation [m].
    covariance : (N, 3, 3) array_like, optional
        Of easting, northing and elevation [m²].
    sigma_m : float or (N,) array_like, optional
        Standard deviation of the elevation [m], for points whose place is exact. Give
        this or `covariance`.
    origins : (N, 3) array_like, optional
        Where the sensor stood [m]: a camera, a scanner or an antenna, not the vehicle's foot.
    range_m : (N,) array_like, optional
        Distance from the sensor when the point was first seen [m].
    values : mapping of str to (N,) array_like
        Other quantities sampled at the points, units in the names: ``temperature_c`` …
    value_sigmas : mapping of str to (N,) array_like
        Standard deviation of each of them, in its unit.
    crs : str or pyproj.CRS
        Projected, in metres.
    vertical_datum : str
        What elevations count from; ``""`` when unstated.
    own_covariance : (N, 3, 3) array_like, optional
        The part of `covariance` that a point shares with no other [m²].
    keyframe : (N,) array_like, optional
        Where among the keyframes of the path the point was seen from: 2.25 is a quarter of
        the way from the third to the fourth (`survey.data.path_error.PathError`). It goes with
        `own_covariance`, `body` and `heading_rad`.
    heading_rad : (N,) array_like, optional
        Heading of the body then, counter-clockwise from east [rad].
    body : (N, 3) array_like, optional
        Place of the body's origin then [m], whose pose the keyframe is; by default the origins.

    Raises
    ------
    InputError
        Wrong shapes, NaN, no points, zero or negative variances, covariances that are
        not symmetric, both or neither of the two uncertainties.

    Examples
    --------
    >>> points = SurfacePoints([[0.0, 0.0, 5.0]], sigma_m=0.1, crs="EPSG:32608")
    >>> points.sigma_z
    array([0.1])
    """

    xyz: FloatArray
    covariance: FloatArray | None = None
    sigma_m: Any = None
    origins: FloatArray | None = None
    range_m: FloatArray | None = None
    values: Mapping[str, FloatArray] = field(default_factory=dict)
    value_sigmas: Mapping[str, FloatArray] = field(default_factory=dict)
    crs: CRS = None  # type: ignore[assignment]  # refused below with a sentence of its own
    vertical_datum: str = UNSTATED
    own_covariance: FloatArray | None = None
    keyframe: FloatArray | None = None
    heading_rad: FloatArray | None = None
    body: FloatArray | None = None

    def __post_init__(self) -> None:
        xyz = checked(self.xyz, (None, 3), "the surface points")
        n = len(xyz)
        if n == 0:
            raise InputError("there are no surface points; at least one is needed.")
        object.__setattr__(self, "xyz", xyz)
        object.__setattr__(self, "crs", projected_crs(self.crs, "the set of surface points"))
        self._check_uncertainty(n)
        if self.origins is not None:
            object.__setattr__(self, "origins", checked(self.origins, (n, 3), "the origins of the sightings"))
        if self.body is not None:
            object.__setattr__(self, "body", checked(self.body, (n, 3), "the places of the body"))
        if self.range_m is not None:
            object.__setattr__(self, "range_m", checked(self.range_m, (n,), "the ranges at first sight"))
        self._check_keyframes(n)
        for name in ("values", "value_sigmas"):
            columns = {
                key: checked(column, (n,), f"the values of {key}")
                for key, column in getattr(self, name).items()
            }
            object.__setattr__(self, name, ReadOnlyMapping(columns))

    def _check_uncertainty(self, n: int) -> None:
        if (self.covariance is None) == (self.sigma_m is None):
            raise InputError("surface points need either a covariance or a sigma_m, and not both.")
        if self.covariance is not None:
            covariance = checked(self.covariance, (n, 3, 3), "the covariances of the surface points")
            variance_z = covariance[:, 2, 2]
            if not np.allclose(covariance, covariance.transpose(0, 2, 1), rtol=1e-9, atol=1e-12):
                raise InputError("some covariances of the surface points are not symmetric; correct them.")
            if (np.linalg.eigvalsh(covariance)[:, 0] < -1e-9 * np.trace(covariance, axis1=1, axis2=2)).any():
                raise InputError(
                    "some covariances of the surface points have negative variances; correct them."
                )
            object.__setattr__(self, "covariance", covariance)
        else:
            sigma = checked(
                np.broadcast_to(np.asarray(self.sigma_m, dtype=np.float64), (n,)), (n,), "the sigmas"
            )
            object.__setattr__(self, "sigma_m", sigma)
            variance_z = np.where(sigma > 0, sigma**2, 0.0)
        n_bad = int((variance_z <= 0.0).sum())
        if n_bad:
            raise InputError(
                f"{n_bad} surface points have an elevation variance of 0 or less; state their standard deviations."
            )

    def _check_keyframes(self, n: int) -> None:
        """Check that points with a keyframe have all fields that it needs."""
        if self.keyframe is None:
            return
        if self.body is None:
            object.__setattr__(self, "body", self.origins)
        needed = {"own_covariance": (n, 3, 3), "keyframe": (n,), "heading_rad": (n,), "body": (n, 3)}
        for name, shape in needed.items():
            if getattr(self, name) is None:
                raise InputError(
                    f"points that carry a keyframe need {name} too; add it or leave the keyframe out."
                )
            object.__setattr__(self, name, checked(getattr(self, name), shape, f"the {name} of the points"))

    @classmethod
    def read(
        cls,
        path: str | Path,
        *,
        crs: Any = None,
        sigma_m: float | None = None,
        vertical_datum: str | None = None,
        columns: Mapping[str, str] | None = None,
        units: str | None = None,
        ground: Ground | None = "auto",
    ) -> Self:
        """Read points from text tables (CSV, TXT, TSV, XYZ), vector files (GeoPackage, GeoJSON, Shapefile), LAS, LAZ or PLY.

        Of LAS and LAZ with classes the points of the ground (classes 2 and 8) are read; where it is not classified, those that a
        filter finds (`survey.data.ground_filter`). Noise (classes 7 and 18), overlap (class 12), withheld and synthetic points are
        left out. Rows that repeat another in every column count once. The log states how many are left out.

        Columns are ``x_m``, ``y_m``, ``z_m`` (the geometry, where the format has one), and
        for the uncertainty either ``sigma_z_m`` or the six ``cov_xx_m2``, ``cov_xy_m2``,
        ``cov_xz_m2``, ``cov_yy_m2``, ``cov_yz_m2``, ``cov_zz_m2``. Optional ones are
        ``origin_x_m``, ``origin_y_m``, ``origin_z_m`` and ``range_m``, and for points of a
        path ``keyframe``, ``heading_rad``, ``body_x_m``, ``body_y_m``, ``body_z_m`` and six ``own_cov_…``. Every other column of
        numbers is a sampled value, such as ``temperature_c``; ``sigma_temperature_c`` is its
        standard deviation.

        Parameters
        ----------
        path : str or pathlib.Path
            The file; its ending names the format.
        crs : str or pyproj.CRS, optional
            For files that carry none, as CSV; refused when the file names another one.
        sigma_m : float, optional
            Standard deviation of the elevation [m] for files that state none.
        vertical_datum : str, optional
            For files that do not state it.
        columns : mapping of str to str, optional
            Column of a table by own name, such as ``{"z_m": "Ellipsoidal height"}``; others are found by their
            usual names. Numbers stand for the columns at those positions.
        units : {"m", "ft", "us-ft"}, optional
            Unit of heights and their standard deviations where neither column, header nor CRS states it. Places and heights
            in feet are converted to metres, and the log states it.
        ground : {"auto", "all", "classified"}, optional
            Of LAS and LAZ: ``all`` reads every point but those that are never used, ``classified`` refuses files without
            points of the ground. None reads classified ground or all, without a filter, as scans of a vehicle need it.

        Raises
        ------
        InputError
            The file is missing, empty or damaged, lacks a column or the uncertainty,
            holds NaN, is in degrees or names no CRS.
        """
        points, notes = cls.read_noted(
            path,
            crs=crs,
            sigma_m=sigma_m,
            vertical_datum=vertical_datum,
            columns=columns,
            units=units,
            ground=ground,
        )
        for note in notes:
            logging.getLogger(__name__).warning(note)
        return points

    @classmethod
    def read_noted(
        cls,
        path: str | Path,
        *,
        crs: Any = None,
        sigma_m: float | None = None,
        vertical_datum: str | None = None,
        columns: Mapping[str, str] | None = None,
        units: str | None = None,
        ground: Ground | None = "auto",
    ) -> tuple[Self, tuple[str, ...]]:
        """Read points as `read` does, and return what is to be known of the points of the ground instead of logging it.

        Parameters
        ----------
        path, crs, sigma_m, vertical_datum, columns, units, ground
            As `read` takes them.

        Returns
        -------
        points : SurfacePoints
            Points of the ground.
        notes : tuple of str
            How many points are left out, by reason, and how the ground was found; none where all are used.
        """
        try:
            read = read_point_table(path, columns, crs=crs, units=units)
            crs = None if crs is None else metric_crs(crs, str(path)).crs
            chosen = choose_points(read, ground, str(path))
            table = project_table(once_each(chosen.table, str(path)), crs, str(path))
            if ground == "auto" and ORIGIN[0] not in table.columns:
                chosen = filter_ground(chosen._replace(table=table))
                table = chosen.table
            return cls._from_table(table, crs, sigma_m, vertical_datum), chosen.notes(str(path))
        except InputError as error:
            message = str(error)
            raise InputError(message if str(path) in message else f"{path}: {message}") from error

    @classmethod
    def _from_table(cls, table: PointTable, crs: Any, sigma_m: float | None, datum: str | None) -> Self:
        columns = dict(table.columns)
        xyz = np.column_stack([columns.pop(name) for name in PLACE])
        covariance, sigma = uncertainty_of(columns, sigma_m)
        origins, body = places_of(columns, ORIGIN), places_of(columns, _BODY)
        range_m = columns.pop(_RANGE, None)
        keyframe, heading = columns.pop(_KEYFRAME, None), columns.pop(_HEADING, None)
        own = symmetric(columns, OWN) if all(name in columns for name in OWN) else None
        sigmas = {
            name.removeprefix(_VALUE_SIGMA): columns.pop(name)
            for name in list(columns)
            if name.startswith(_VALUE_SIGMA)
        }
        stated = datum_of_file(table.vertical_datum, crs, "the file")
        if stated and datum:
            same_vertical_datum(stated, datum, "the file and the request")
        return cls(
            xyz,
            covariance,
            sigma,
            origins,
            range_m,
            columns,
            sigmas,
            one_crs(table.crs, crs),
            stated or datum or UNSTATED,
            own,
            keyframe,
            heading,
            body,
        )

    def write(self, path: str | Path) -> None:
        """Write the columns that `read` describes to the format that the file's ending names.

        Equal points give equal bytes. CSV carries neither CRS nor vertical datum; LAS and
        LAZ round coordinates to 0.1 mm.

        Parameters
        ----------
        path : str or pathlib.Path
            The file; its ending names the format.

        Raises
        ------
        InputError
            Another ending, a missing folder or a full disk.
        """
        columns: dict[str, FloatArray] = dict(zip(PLACE, self.xyz.T, strict=True)) | self._columns()
        write_point_table(path, PointTable(columns, self.crs, self.vertical_datum))

    def _columns(self) -> dict[str, FloatArray]:
        """Return every column beside the place, one value for each point."""
        columns: dict[str, FloatArray] = {}
        if self.covariance is not None:
            columns |= {name: self.covariance[:, i, j] for name, (i, j) in COVARIANCE.items()}
        else:
            columns[SIGMA] = self.sigma_z
        if self.origins is not None:
            columns |= dict(zip(ORIGIN, self.origins.T, strict=True))
        if self.range_m is not None:
            columns[_RANGE] = self.range_m
        if self.keyframe is not None and self.own_covariance is not None and self.heading_rad is not None:
            columns |= {name: self.own_covariance[:, i, j] for name, (i, j) in OWN.items()}
            columns |= {_KEYFRAME: self.keyframe, _HEADING: self.heading_rad}
        if self.body is not None:
            columns |= dict(zip(_BODY, self.body.T, strict=True))
        columns |= dict(self.values)
        return columns | {_VALUE_SIGMA + name: sigma for name, sigma in self.value_sigmas.items()}

    @drawing
    def plot(self, ax: "Axes | None" = None) -> "Axes":
        """Draw the points in the colour of their elevation.

        $axes
        """
        return draw_points(ax, self.xy, self.z, "Elevation [m]")

    def to_geodataframe(self) -> "GeoDataFrame":
        """Return the points as a table with the columns that `write` writes.

        Returns
        -------
        geopandas.GeoDataFrame
            One row for each point; its geometry has easting, northing and elevation [m].

        Raises
        ------
        InputError
            When GeoPandas is not installed.
        """
        return to_geodataframe(shapely.points(self.xyz), self._columns(), self.crs)

    def _summary(self) -> str:
        return f"{len(self)} points, {value_range(self.z)}, {self.crs.name}"

    def _repr_html_(self) -> str:
        facts = {"points": str(len(self)), "elevation": value_range(self.z), "CRS": self.crs.name}
        return html_table("SurfacePoints", facts, self.plot)

    def __len__(self) -> int:
        return len(self.xyz)

    @property
    def xy(self) -> FloatArray:
        """Easting and northing [m], (N, 2)."""
        return self.xyz[:, :2]

    @property
    def z(self) -> FloatArray:
        """Elevation [m], (N,)."""
        return self.xyz[:, 2]

    @property
    def sigma_z(self) -> FloatArray:
        """Marginal standard deviation of the elevation [m], (N,), as Eq. 7 has it."""
        if self.covariance is not None:
            return np.sqrt(self.covariance[:, 2, 2])
        sigma: FloatArray = self.sigma_m
        return sigma

    def select(self, mask: BoolArray) -> Self:
        """Return the points for which `mask` (N,) holds, or those at the given indices.

        Parameters
        ----------
        mask : (N,) ndarray of bool, or of int
            Points to take.

        Returns
        -------
        SurfacePoints
            With every column of the points taken.
        """

        def pick(array: FloatArray | None) -> Any:
            return None if array is None else frozen(array[mask])

        return type(self)(
            frozen(self.xyz[mask]),
            pick(self.covariance),
            pick(self.sigma_m),
            pick(self.origins),
            pick(self.range_m),
            {name: frozen(column[mask]) for name, column in self.values.items()},
            {name: frozen(column[mask]) for name, column in self.value_sigmas.items()},
            self.crs,
            self.vertical_datum,
            pick(self.own_covariance),
            pick(self.keyframe),
            pick(self.heading_rad),
            pick(self.body),
        )


COVARIANCE = {
    "cov_xx_m2": (0, 0), "cov_xy_m2": (0, 1), "cov_xz_m2": (0, 2), "cov_yy_m2": (1, 1),
    "cov_yz_m2": (1, 2), "cov_zz_m2": (2, 2),
}  # fmt: skip
ORIGIN = ("origin_x_m", "origin_y_m", "origin_z_m")
OWN = {f"own_{name}": place for name, place in COVARIANCE.items()}


def places_of(columns: dict[str, FloatArray], names: tuple[str, ...]) -> FloatArray | None:
    """Take the columns of a place out, and return it (N, 3), or None where one of them is missing."""
    if not all(name in columns for name in names):
        return None
    return np.column_stack([columns.pop(name) for name in names])


def project_table(table: PointTable, crs: Any, where: str) -> PointTable:
    """Project places in degrees to the named CRS or to their UTM zone, and log it; leave metres as they are."""
    stated = None if table.crs is None else known_crs(table.crs, where)
    if stated is None or not stated.is_geographic:
        _refuse_misplaced(table, stated or crs, where)
        return table
    if any(name in table.columns for name in ORIGIN):
        raise InputError(
            f"{where} has places in degrees and {ORIGIN[0]} in metres; write both in one projected CRS."
        )
    x, y = (table.columns[name] for name in PLACE[:2])
    target = chosen_crs(x, y) if crs is None else projected_crs(crs, where)
    east, north = transformed(np.column_stack([x, y]), stated, target, where).T
    log_projection(where, target)
    return table._replace(columns={**table.columns, PLACE[0]: east, PLACE[1]: north}, crs=target)


def _refuse_misplaced(table: PointTable, crs: Any, where: str) -> None:
    """Refuse a table whose easting and northing are exchanged or degrees; one without a CRS is refused later."""
    if crs is not None and not is_local(crs):
        places = np.column_stack([table.columns[name] for name in PLACE[:2]])
        refuse_exchanged(places, known_crs(crs, where), where)
        refuse_degrees(places, known_crs(crs, where), where)


def symmetric(columns: dict[str, FloatArray], names: Mapping[str, tuple[int, int]]) -> FloatArray:
    """Take the columns of a symmetric matrix out, and return it (N, 3, 3)."""
    entries = {name: columns.pop(name) for name in names}
    matrices = np.empty((len(next(iter(entries.values()))), 3, 3))
    for name, (i, j) in names.items():
        matrices[:, i, j] = matrices[:, j, i] = entries[name]
    return matrices


def uncertainty_of(
    columns: dict[str, FloatArray], sigma_m: float | None
) -> tuple[FloatArray | None, FloatArray | float | None]:
    """Take the columns of the uncertainty out, and return the covariance or the sigma."""
    found = [name for name in COVARIANCE if name in columns]
    sigma = columns.pop(SIGMA, None)
    if found and len(found) < len(COVARIANCE):
        missing = ", ".join(name for name in COVARIANCE if name not in found)
        raise InputError(f"the covariance lacks the columns {missing}; give all six or {SIGMA}.")
    if found:
        return symmetric(columns, COVARIANCE), None
    if sigma is None and sigma_m is None:
        raise InputError(
            f"the file states no standard deviation of its heights; name one for all with --sigma, choose a column with --columns "
            f"sigma_z=NAME, or add a column {SIGMA} or the six cov_*_m2."
        )
    return None, sigma if sigma is not None else sigma_m


def one_crs(stated: Any, named: Any) -> CRS:
    """Return the CRS of the file or, where it has none, the one that was named."""
    if stated is None or named is None or is_local(stated):
        return agreed_crs(stated, named, "the set of surface points")
    of_file, wanted = (projected_crs(crs, "the set of surface points") for crs in (stated, named))
    same_crs(of_file, wanted, "the file and the request")
    return of_file
