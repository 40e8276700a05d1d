"""Terrain maps with uncertainty: height, standard deviation and support code of every node, and the record of the method.

`Reconstruction` holds the rasters with hyperparameters and diagnostics, and writes and reads them. `support_codes` marks
nodes as measured, interpolated or unseen. The description file ``reconstruction.json`` holds the record as JSON with a
checksum; a file that was changed afterwards is refused.
"""

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

import numpy as np
import numpy.typing as npt

from survey.core import (
    DataObject,
    FloatArray,
    InputError,
    ReadOnlyMapping,
    existing_file,
    frozen,
    parse_json,
    replacing,
    same_crs,
)
from survey.core.documents import is_intact, with_checksum
from survey.data import Dem
from survey.data.conversions import drawing, html_table, optional, plot_raster, value_range
from survey.io.raster import read_raster, write_raster
from survey.io.raster.netcdf import dataset_of, deviation_attributes, height_attributes
from survey.io.raster.writing import write_categories
from survey.reconstruction.checks import PredictiveCheck, RmseClaim

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from xarray import Dataset


UNSEEN, INTERPOLATED, RAY_BOUNDED, MEASURED = 0, 1, 2, 3
SUPPORT_NAMES = ("Unseen", "Interpolated", "Ray-bounded", "Measured")
"""Codes of `Reconstruction.support`: what stands behind the height of a node."""
_SUPPORT_ATTRIBUTES = {
    "long_name": "what stands behind the value",
    "flag_values": np.arange(len(SUPPORT_NAMES), dtype=np.uint8),
    "flag_meanings": " ".join(name.lower().replace("-", "_") for name in SUPPORT_NAMES),
}


ELEVATION = "elevation_m"
CHECK, CLAIM, BEYOND = "left_out_check", "rmse_claim", "beyond_points"
"""Entries of the diagnostics: test by points that were left out, posterior of the map's error, and ground far from all points."""
METHOD_CHOICE = "method_choice"
"""Entry of the diagnostics: the method that was chosen, and why."""
ADJUSTMENT = "strip_adjustment"
"""Entry of the diagnostics: what the overlaps of strips show, and whether the points are adjusted."""
STRIP_NAMES = ("strip", "point_source_id")
"""Values that hold the number of each point's strip; the point source of LAS is read as the first."""
_SYMBOLS = {"c": "°C", "degC": "°C", "percent": "%"}
_UDUNITS = {"°C": "degree_Celsius", "%": "percent"}
SIGMAS_95 = 1.959964
"""Standard deviations on either side of the mean that hold 95 %."""


@dataclass(frozen=True, eq=False, repr=False)
class Reconstruction(DataObject):
    """A map of the terrain with its uncertainty.

    Parameters
    ----------
    mean : Dem
        Most likely height at every node of a grid [m]; NaN where the method is silent.
    std : Dem
        Standard deviation of that height [m].
    support : (H, W) array_like of int
        0 unseen, 1 interpolated, 2 bounded by a line of sight, 3 measured.
    method : str
        The method's name: ``gp``, ``dense``, ``tin`` …
    hyperparameters : mapping of str to float, str or list
        What the method assumed or fitted, units in the names.
    lower, upper : Dem, optional
        Bounds of the height [m], where a method gives other ones than ``mean ± k std``.
    quantity : str
        What is mapped, with its unit: ``elevation_m`` unless another value was asked for.
    diagnostics : mapping of str to float, str or list
        What the method found out about its input: outliers, the calibration …

    Raises
    ------
    InputError
        When the rasters do not lie on one grid, or a support code is unknown.

    Notes
    -----
    One height per place: no overhangs, no open crevasses.

    Examples
    --------
    >>> from survey.data.grid import Grid
    >>> grid = Grid((0.0, 0.0, 2.0, 1.0), 1.0)
    >>> flat = Dem.on(grid, np.zeros(grid.shape))
    >>> Reconstruction(flat, flat, np.full(grid.shape, MEASURED), "tin", {}).share_of(MEASURED)
    1.0
    """

    mean: Dem
    std: Dem
    support: npt.NDArray[np.uint8]
    method: str
    hyperparameters: Mapping[str, Any]
    lower: Dem | None = None
    upper: Dem | None = None
    quantity: str = ELEVATION
    diagnostics: Mapping[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        codes = np.asarray(self.support)
        if codes.shape != self.mean.shape or not np.isin(codes, (0, 1, 2, 3)).all():
            raise InputError(
                f"the support codes have the shape {codes.shape} for a map of {self.mean.shape}, or values other "
                "than 0, 1, 2, 3; give one code per node."
            )
        object.__setattr__(self, "support", frozen(codes, np.uint8))
        for name in ("std", "lower", "upper"):
            dem: Dem | None = getattr(self, name)
            if dem is None:
                continue
            same_crs(self.mean.crs, dem.crs, f"the mean and the {name}")
            if dem.shape != self.mean.shape or not dem.transform.almost_equals(self.mean.transform):
                raise InputError(f"the mean and the {name} do not lie on one grid; compute both on the same.")
        for name in ("hyperparameters", "diagnostics"):
            object.__setattr__(self, name, ReadOnlyMapping(plain_facts(getattr(self, name), name)))

    @property
    def check(self) -> PredictiveCheck | None:
        """Test of the standard deviation by points that were left out; None where none was made."""
        facts = self.diagnostics.get(CHECK)
        return PredictiveCheck.from_facts(facts) if facts else None

    @property
    def claim(self) -> RmseClaim | None:
        """Posterior of the map's error by its own claim; None where the method has no joint covariance."""
        facts = self.diagnostics.get(CLAIM)
        return RmseClaim.from_facts(facts) if facts else None

    def share_of(self, code: int) -> float:
        """Return the share of nodes with this support code.

        Parameters
        ----------
        code : int
            0 unseen, 1 interpolated, 2 bounded by a line of sight, 3 measured.

        Returns
        -------
        float
            Between 0 and 1.
        """
        return float(np.mean(self.support == code))

    def interval(self, sigmas: float = SIGMAS_95) -> tuple[Dem, Dem]:
        """Return lower and upper height [m]: the method's own bounds, or ``mean ± sigmas · std``.

        Parameters
        ----------
        sigmas : float
            Half width of the interval in standard deviations.

        Returns
        -------
        Dem, Dem
            Lower and upper bound [m].
        """
        if self.lower is not None and self.upper is not None:
            return self.lower, self.upper
        grid, half = self.mean.grid(), sigmas * self.std.elevation
        datum = self.mean.vertical_datum
        return (
            Dem.on(grid, self.mean.elevation - half, datum),
            Dem.on(grid, self.mean.elevation + half, datum),
        )

    @drawing
    def plot(self, ax: "Axes | None" = None) -> "Axes":
        """Draw the mean as a coloured raster.

        $axes
        """
        return plot_raster(ax, self.mean.elevation, self.mean.bounds, self._name_and_unit()[2])

    def to_xarray(self) -> "Dataset":
        """Return mean, standard deviation and support codes as an xarray object with CF metadata.

        Returns
        -------
        xarray.Dataset
            Dimensions y and x [m]; variables ``elevation`` (or the quantity that is mapped),
            ``standard_deviation`` and ``support``, ``lower`` and ``upper`` where the method gives them.

        Raises
        ------
        InputError
            When xarray is not installed.
        """
        optional("xarray", "to_xarray")
        name, unit, _ = self._name_and_unit()
        unit = _UDUNITS.get(unit, unit)
        is_height = self.quantity == ELEVATION
        about = (
            height_attributes(self.mean.vertical_datum) if is_height else {"long_name": name, "units": unit}
        )
        beside = {"ancillary_variables": "standard_deviation support"}
        bounds = {"lower": self.lower, "upper": self.upper}
        variables: dict[str, tuple[npt.NDArray[Any], Mapping[str, Any]]] = {
            name: (self.mean.elevation, about | beside),
            "standard_deviation": (self.std.elevation, deviation_attributes(about)),
            "support": (self.support, _SUPPORT_ATTRIBUTES),
        }
        variables |= {
            key: (dem.elevation, {"long_name": f"{key} bound of the {name}", "units": unit})
            for key, dem in bounds.items()
            if dem is not None
        }
        mean = self.mean
        return dataset_of(variables, mean.transform, mean.crs, mean.vertical_datum, {"method": self.method})

    def _name_and_unit(self) -> tuple[str, str, str]:
        """Return the name of the quantity, its unit, and the label of an axis."""
        name, _, ending = self.quantity.rpartition("_")
        unit = _SYMBOLS.get(ending, ending)
        return name, unit, f"{name.replace('_', ' ').capitalize()} [{unit}]"

    def _facts(self) -> dict[str, str]:
        rows, columns = self.mean.shape
        name, unit, _ = self._name_and_unit()
        return {
            "method": self.method,
            "nodes": f"{rows} × {columns} of {self.mean.step_m:g} m",
            name: value_range(self.mean.elevation, unit),
            "standard deviation": f"σ {value_range(self.std.elevation, unit)}",
            "CRS": self.mean.crs.name,
        }

    def _summary(self) -> str:
        return ", ".join(self._facts().values())

    def _repr_html_(self) -> str:
        return html_table("Reconstruction", self._facts(), self.plot)

    def write(self, folder: str | Path) -> None:
        """Write ``dem.tif``, ``support.tif`` and ``reconstruction.json`` into an existing folder.

        ``dem.tif`` is a Cloud-Optimized GeoTIFF of two bands, elevation and standard
        deviation [m]. Bounds of the method's own go to ``bounds.tif``. Equal maps give
        equal bytes. Rasters hold float32, which is 0.25 mm at 4,000 m.

        Parameters
        ----------
        folder : str or pathlib.Path
            Existing folder.

        Raises
        ------
        InputError
            When the folder is missing or cannot be written to.
        """
        place = Path(folder)
        dem = self.mean
        name = self.quantity.rsplit("_", 1)[0] if self.quantity != ELEVATION else "elevation"

        def write(file: str, bands: dict[str, FloatArray]) -> None:
            write_raster(place / file, bands, dem.transform, dem.crs, dem.vertical_datum)

        write("dem.tif", {name: dem.elevation, "standard_deviation": self.std.elevation})
        write_categories(
            place / "support.tif", self.support, SUPPORT_NAMES, transform=dem.transform, crs=dem.crs
        )
        if self.lower is not None and self.upper is not None:
            write("bounds.tif", {"lower": self.lower.elevation, "upper": self.upper.elevation})
        facts = {
            "method": self.method,
            "quantity": self.quantity,
            "hyperparameters": dict(self.hyperparameters),
            "diagnostics": dict(self.diagnostics),
        }
        with replacing(place / "reconstruction.json") as draft:
            text = json.dumps(with_checksum(facts, FACTS_SHA256), indent=2, sort_keys=True)
            draft.write_text(text + "\n", encoding="utf-8")

    @classmethod
    def read(cls, folder: str | Path) -> Self:
        """Read what `write` wrote.

        Parameters
        ----------
        folder : str or pathlib.Path
            Folder that `write` wrote into.

        Returns
        -------
        Reconstruction
            Map with standard deviation and support.

        Raises
        ------
        InputError
            When a file is missing, empty or damaged.
        """
        place = Path(folder)
        facts = read_facts(place / "reconstruction.json")
        mean, std = (Dem.read(place / "dem.tif", band=band) for band in (1, 2))
        support = read_raster(place / "support.tif").values
        if not np.isin(support, (0, 1, 2, 3)).all():
            raise InputError(f"{place / 'support.tif'} holds codes other than 0 to 3; reconstruct again.")
        bounds = place / "bounds.tif"
        lower, upper = (Dem.read(bounds, band=band) for band in (1, 2)) if bounds.exists() else (None, None)
        return cls(
            mean,
            std,
            support.astype(np.uint8),
            facts["method"],
            facts["hyperparameters"],
            lower,
            upper,
            facts["quantity"],
            facts["diagnostics"],
        )


_NEAR_LENGTHS = 0.25
_UNSEEN_RATIO = 0.9


def support_codes(
    nearest_m: FloatArray, variance_ratio: FloatArray, *, shortest_length_m: float, step_m: float = 0.0
) -> npt.NDArray[np.uint8]:
    """Return the support code of every place.

    A place is measured when the nearest point (`nearest_m` away) lies within a quarter of
    the shortest length scale or half a cell's diagonal; unseen when the points took away
    less than a tenth of the prior variance (`variance_ratio`, posterior over prior, above
    0.9); interpolated otherwise.

    >>> support_codes(np.array([0.0, 8.0, 90.0]), np.array([0.0, 0.4, 1.0]), shortest_length_m=10.0)
    array([3, 1, 0], dtype=uint8)
    """
    reach = max(_NEAR_LENGTHS * shortest_length_m, step_m / np.sqrt(2.0))
    codes = np.where(variance_ratio > _UNSEEN_RATIO, UNSEEN, INTERPOLATED)
    return np.where(nearest_m <= reach, MEASURED, codes).astype(np.uint8)


FACTS_SHA256 = "facts_sha256"


def plain_facts(values: Mapping[str, Any], name: str) -> dict[str, Any]:
    """Return a copy of numbers, texts and lists as JSON has them."""
    try:
        text = json.dumps(dict(values), default=_number, allow_nan=False)
    except (TypeError, ValueError) as error:
        raise InputError(
            f"the {name} hold what JSON cannot ({error}); give numbers, texts and lists."
        ) from error
    result: dict[str, Any] = json.loads(text)
    return result


def _number(value: Any) -> Any:
    if isinstance(value, np.ndarray | np.generic):
        return value.tolist()
    raise TypeError(f"a {type(value).__name__}")


def read_facts(path: Path) -> dict[str, Any]:
    """Read the description file, and refuse a damaged one."""
    file = existing_file(path, "the reconstruction's description")
    try:
        facts: dict[str, Any] = parse_json(file.read_bytes(), str(file), "reconstruct again")
        missing = {"method", "quantity", "hyperparameters", "diagnostics"} - set(facts)
    except TypeError as error:
        raise InputError(f"{file} is damaged ({error}); reconstruct again.") from error
    if missing:
        raise InputError(f"{file} lacks {', '.join(sorted(missing))}; reconstruct again.")
    if not is_intact(facts, FACTS_SHA256):
        raise InputError(f"{file} was changed, or was written by an older version; reconstruct again.")
    return facts
