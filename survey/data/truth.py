"""True states of a simulated survey: read by scoring and by tests, never by an estimator."""

from dataclasses import dataclass
from pathlib import Path
from typing import Self

from survey.core.arrays import DataObject
from survey.data.dem import Dem
from survey.data.trajectory import Trajectory


@dataclass(frozen=True, eq=False, repr=False)
class Truth(DataObject):
    """The real terrain and the path that was really driven.

    Parameters
    ----------
    dem : Dem
        The terrain at the resolution of the simulation.
    trajectory : Trajectory
        Poses of the rover; covariance 0.
    """

    dem: Dem
    trajectory: Trajectory

    def write(self, folder: str | Path) -> None:
        """Write ``dem.tif`` and ``trajectory.tum`` into a folder.

        Parameters
        ----------
        folder : str or pathlib.Path
            Existing folder.
        """
        place = Path(folder)
        place.mkdir(parents=True, exist_ok=True)
        self.dem.write(place / "dem.tif")
        self.trajectory.write(place / "trajectory.tum")

    @classmethod
    def read(cls, folder: str | Path) -> Self:
        """Read what `write` wrote.

        Parameters
        ----------
        folder : str or pathlib.Path
            Folder that `write` wrote to.

        Returns
        -------
        Truth
            True states.
        """
        dem = Dem.read(Path(folder) / "dem.tif")
        return cls(dem, Trajectory.read(Path(folder) / "trajectory.tum", dem.crs))
