"""Joint map of everything that was measured so far, with a covariance that was fitted before.

An update solves the joint estimate of `survey.reconstruction.joint` again with the covariance of the terrain as it was
last fitted. With samples that share one error its cost is that of the waves and hardly depends on the number of samples. With
landmarks the errors of the path are eliminated segment by segment (`live.solve`), so that it grows with the ground that was
seen, not with the number of landmarks.
"""

from dataclasses import dataclass

import numpy as np
from scipy import sparse

from live.solve.segment_map import segment_map
from survey.core.arrays import FloatArray
from survey.data.grid import Grid
from survey.data.path_error import POSE, PathError
from survey.data.surface_points import SurfacePoints
from survey.reconstruction.gp.config import GaussianProcessConfig, JointConfig
from survey.reconstruction.gp.kernels import Kernel
from survey.reconstruction.joint.joint_map import JointTerrain

MEMORY_MB = 50.0
"""Memory of the covariance of an update [MB], that of a final map: 2,500 waves."""
_LEAST_SHARED_M = 1e-3


@dataclass(frozen=True)
class LiveMap:
    """Map from a covariance of the terrain that stays as it is between updates.

    Parameters
    ----------
    kernel : Kernel
        Covariance of the terrain, as last fitted.
    nugget_m : float
        Standard deviation of relief too fine to be mapped [m].
    grid : Grid
        Nodes of the map.
    memory_mb : float
        Memory of the covariance [MB].
    """

    kernel: Kernel
    nugget_m: float
    grid: Grid
    memory_mb: float = MEMORY_MB

    def of_landmarks(self, points: SurfacePoints, path: PathError) -> tuple[FloatArray, FloatArray]:
        """Return height and standard deviation (H, W) [m] from landmarks and the error of their path.

        Parameters
        ----------
        points : SurfacePoints
            That name their keyframes.
        path : PathError
            Posterior of the path so far.

        Returns
        -------
        tuple of ndarray
            On the nodes of the grid, relief finer than the map included.
        """
        terrain = self._terrain(path, JointConfig())
        start = terrain.from_points(points, self.grid.bounds)
        found, memory_mb = start.candidates[0], self.memory_mb
        system = terrain.system(points, self.grid.bounds, found, start.slope, memory_mb=memory_mb)
        return segment_map(system, path, points, self.grid, self.nugget_m)

    def of_samples(
        self, xyz: FloatArray, sigma_m: FloatArray, shared_m: float = 0.0
    ) -> tuple[FloatArray, FloatArray]:
        """Return height and standard deviation (H, W) [m] from samples that share one error of height.

        Parameters
        ----------
        xyz : (N, 3) ndarray
            Easting, northing, height [m].
        sigma_m : (N,) ndarray
            Standard deviation of each height [m].
        shared_m : float
            Standard deviation of the error that all heights share [m].

        Returns
        -------
        tuple of ndarray
            On the nodes of the grid.
        """
        own = np.zeros((len(xyz), 3, 3))
        own[:, 2, 2] = sigma_m**2
        shared = np.zeros((3, 3))
        shared[2, 2] = shared_m**2
        points = SurfacePoints(
            xyz,
            own + shared,
            crs=self.grid.crs,
            own_covariance=own,
            keyframe=np.zeros(len(xyz)),
            heading_rad=np.zeros(len(xyz)),
            body=xyz,
        )
        joint = JointConfig(
            memory_mb=self.memory_mb, slope_passes=1, far_bias_sigma_m=0.0, landmark_shared_sigma_m=0.0
        )
        terrain = self._terrain(_one_offset(max(shared_m, _LEAST_SHARED_M)), joint)
        return terrain.solved(points, self.grid.bounds).terrain.fields(self.grid)

    def _terrain(self, path: PathError, joint: JointConfig) -> JointTerrain:
        config = GaussianProcessConfig(fit=False, kernel=self.kernel, nugget_m=self.nugget_m, mean="plane")
        return JointTerrain(path, None, config, joint)


def _one_offset(sigma_m: float) -> PathError:
    """Return the error of a path that is an offset of height [m], the same at its two keyframes."""
    exact = 1.0 / _LEAST_SHARED_M**2
    diagonal = np.tile([exact, exact, 1.0 / sigma_m**2, 1.0, 1.0, 1.0], 2)
    assert len(diagonal) == 2 * POSE
    return PathError(np.array([0.0, 1.0]), sparse.csr_array(sparse.diags_array(diagonal)))
