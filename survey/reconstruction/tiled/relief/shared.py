"""What all tiles share, solved in one place: errors of strips, scatter of points, long relief, fine stiffness."""

from typing import Any, NamedTuple

import numpy as np

from survey.core.arrays import FloatArray
from survey.core.errors import InputError
from survey.core.files.writing import replacing
from survey.reconstruction.lattice.calibration import LatticeCalibration
from survey.reconstruction.lattice.stiffness import Stiffness
from survey.reconstruction.tiled.job import TiledJob, load_arrays
from survey.reconstruction.tiled.layout import MapTile
from survey.reconstruction.tiled.relief.fine_relief import FineRelief
from survey.reconstruction.tiled.relief.long_relief import LongRelief, long_relief, relief_arrays, relief_of
from survey.reconstruction.tiled.strips.pairs import StripPairs
from survey.reconstruction.tiled.strips.places import StripPlaces
from survey.reconstruction.tiled.strips.solution import solve_strips
from survey.reconstruction.tiled.strips.strip_errors import Sizes, StripErrors, as_arrays, from_arrays

_USUAL_M2 = 0.05**2


class Shared(NamedTuple):
    """What all tiles share.

    Parameters
    ----------
    strips : StripErrors
        Errors of strips.
    usual_m2 : float
        Variance of a point about the ground [m²].
    relief : LongRelief
        Relief longer than some blocks of cells.
    n_control : int
        Differences of strips and control points.
    pairs : StripPairs
        Overlapping strips.
    """

    strips: StripErrors
    usual_m2: float
    relief: LongRelief
    n_control: int
    pairs: StripPairs


class Learnt(NamedTuple):
    """Prior of the fine relief, and factors on the standard deviations by withheld cells.

    Parameters
    ----------
    stiffness : Stiffness
        Prior of the fine relief.
    calibration : LatticeCalibration
        Factors by withheld cells.
    within_cells : float
        Variance of a height in a measured cell as a share of that at its middle, see `variance_within_cells`.
    """

    stiffness: Stiffness
    calibration: LatticeCalibration
    within_cells: float = 1.0

    def surface_variance(self, fine: FineRelief) -> FloatArray:
        """Return the variance (H, W) of the fine relief [m²] with the factors."""
        share = np.where(fine.away < 1.0, self.within_cells, 1.0)
        variance: FloatArray = self.calibration.surface**2 * share * fine.variance
        return variance


def solve_shared(job: TiledJob, tiles: list[MapTile]) -> Shared:
    """Return what the summaries of all tiles determine, and write it; what is there is read.

    Raises
    ------
    InputError
        No tile holds a point.
    CapacityError
        More strips than can be solved together.
    """
    if job.shared_file.exists():
        return read_shared(job)
    found = [load_arrays(job.summary_file(tile)) for tile in tiles]
    if not found:
        raise InputError("no point lies in the map; check --area and the CRS of the points.")
    places = StripPlaces.of([np.asarray(each["strips"], np.float64) for each in found])
    overlaps = np.concatenate([each["overlaps"] for each in found])
    control = np.concatenate([each["control"] for each in found])
    expected = Sizes(job.config.strip_offset_m, job.config.strip_tilt_m)
    strips = solve_strips(places, overlaps, control, expected)
    usual, counts = np.array([each["usual_m2"] for each in found], np.float64).T
    known = np.isfinite(usual)
    usual_m2 = float(np.average(usual[known], weights=counts[known])) if known.any() else _USUAL_M2
    blocks = np.concatenate([np.asarray(each["blocks"], np.float64) for each in found])
    prior = np.load(job.prior_file) if job.prior_file.exists() else None
    relief = long_relief(job.layout, job.config.coarse_cells, blocks, strips, prior)
    shared = Shared(strips, usual_m2, relief, len(control), StripPairs.of(overlaps))
    with replacing(job.shared_file) as draft:
        arrays: dict[str, Any] = {**as_arrays(strips), **relief_arrays(relief)}
        np.savez(draft, numbers=np.array([usual_m2, len(control)]), pairs=shared.pairs.table, **arrays)
    return shared


def read_shared(job: TiledJob) -> Shared:
    """Return what `solve_shared` wrote."""
    arrays = load_arrays(job.shared_file)
    usual_m2, n_control = (float(v) for v in np.asarray(arrays["numbers"], np.float64))
    numbers = {name: np.asarray(values, np.float64) for name, values in arrays.items()}
    return Shared(
        from_arrays(numbers), usual_m2, relief_of(numbers), int(n_control), StripPairs(numbers["pairs"])
    )
