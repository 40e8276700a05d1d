"""How far an estimated trajectory is from a reference."""

from dataclasses import asdict, dataclass

import numpy as np

from survey.errors import InputError
from survey.geodesy import same_crs
from survey.trajectory import Trajectory


@dataclass(frozen=True)
class TrajectoryError:
    """Absolute trajectory error, without any alignment [m].

    ``horizontal_rms_m`` and ``vertical_rms_m`` over all poses, ``end_m`` at the last
    one, ``end_per_cent`` of the distance travelled, ``worst_m`` anywhere;
    ``normalised_squared`` is the mean of eᵀ P⁻¹ e, 3 when covariances are honest.
    """

    horizontal_rms_m: float
    vertical_rms_m: float
    end_m: float
    end_per_cent: float
    worst_m: float
    normalised_squared: float

    def to_dict(self) -> dict[str, float]:
        """Return the figures by name."""
        return asdict(self)


def trajectory_error(estimate: Trajectory, reference: Trajectory) -> TrajectoryError:
    """Compare an estimated trajectory with a reference, pose by pose in time.

    Nothing is aligned: scale, heading and place errors all count. The reference is
    interpolated linearly to the estimate's times.

    Raises
    ------
    InputError
        Different CRS, or times of the estimate that the reference does not cover.

    Examples
    --------
    >>> import numpy as np
    >>> def line(shift):
    ...     place = np.column_stack([np.arange(3.0), np.zeros(3), np.full(3, shift)])
    ...     return Trajectory(np.arange(3.0), place, np.tile([0, 0, 0, 1.0], (3, 1)), np.tile(np.eye(3), (3, 1, 1)), "EPSG:32608")
    >>> trajectory_error(line(0.5), line(0.0)).vertical_rms_m
    0.5
    """
    same_crs(estimate.crs, reference.crs, "the two trajectories")
    first, last = reference.time_s[[0, -1]]
    if estimate.time_s[0] < first - 1e-9 or estimate.time_s[-1] > last + 1e-9:
        raise InputError(
            f"the estimate covers {estimate.time_s[0]:.1f} to {estimate.time_s[-1]:.1f} s, the reference only "
            f"{first:.1f} to {last:.1f} s; cut the estimate or take another reference."
        )
    place = np.column_stack([np.interp(estimate.time_s, reference.time_s, c) for c in reference.position.T])
    error = estimate.position - place
    distance = np.linalg.norm(error, axis=1)
    squared = np.einsum("ni,ni->n", error, np.linalg.solve(estimate.covariance, error[:, :, None])[:, :, 0])
    return TrajectoryError(
        horizontal_rms_m=float(np.sqrt(np.mean(error[:, 0] ** 2 + error[:, 1] ** 2))),
        vertical_rms_m=float(np.sqrt(np.mean(error[:, 2] ** 2))),
        end_m=float(distance[-1]),
        end_per_cent=float(100.0 * distance[-1] / reference.length_m),
        worst_m=float(distance.max()),
        normalised_squared=float(squared.mean()),
    )
