"""Returns of a LiDAR as it records them, and places of returns in the frame of the vehicle."""

from pathlib import Path
from typing import Any, NamedTuple, Self

import numpy as np
import numpy.typing as npt

from survey.core.arrays import FloatArray
from survey.core.errors import InputError
from survey.io.arrays_file import read_npz, write_npz

_KINDS = {"scan": np.uint32, "column": np.uint16, "beam": np.uint8, "range_mm": np.uint32}


class LidarReturns(NamedTuple):
    """Returns of some scans, in the order of the scans.

    Parameters
    ----------
    scan : (N,) ndarray of uint32
        Number of the scan in the recording.
    column : (N,) ndarray of uint16
        Direction of the turn.
    beam : (N,) ndarray of uint8
        Number of the beam.
    range_mm : (N,) ndarray of uint32
        Distance from the scanner [mm].
    """

    scan: npt.NDArray[np.uint32]
    column: npt.NDArray[np.uint16]
    beam: npt.NDArray[np.uint8]
    range_mm: npt.NDArray[np.uint32]

    @classmethod
    def of(cls, scan: Any, column: Any, beam: Any, range_m: FloatArray) -> Self:
        """Return the returns of whole numbers and ranges (N,) [m], which are rounded to millimetres.

        Parameters
        ----------
        scan, column, beam : (N,) array_like of int
            As in the class.
        range_m : (N,) ndarray
            Distances [m].

        Returns
        -------
        LidarReturns
            In the smallest types that hold them.
        """
        columns = zip(_KINDS.values(), (scan, column, beam, np.rint(1e3 * range_m)), strict=True)
        return cls(*(np.asarray(values).astype(kind) for kind, values in columns))

    def part(self, begin: int, end: int) -> Self:
        """Return the returns from one number up to another.

        Parameters
        ----------
        begin, end : int
            First number, and the one after the last.

        Returns
        -------
        LidarReturns
            Views of the same arrays.
        """
        return type(self)(
            self.scan[begin:end], self.column[begin:end], self.beam[begin:end], self.range_mm[begin:end]
        )

    def write(self, path: str | Path) -> None:
        """Write one compressed ``.npz`` file; equal returns give equal bytes.

        Parameters
        ----------
        path : str or pathlib.Path
            Ends in ``.npz``.
        """
        write_npz(path, self._asdict())

    @classmethod
    def read(cls, path: str | Path) -> Self:
        """Read what `write` wrote.

        Parameters
        ----------
        path : str or pathlib.Path
            File of `write`.

        Returns
        -------
        LidarReturns
            Equal to those written.

        Raises
        ------
        InputError
            The file is missing, damaged or holds something else.
        """
        stored = read_npz(path, "the minute of LiDAR scans", "make the recording again")
        found = {name: (values.dtype, values.ndim) for name, values in stored.items()}
        wanted = {name: (np.dtype(kind), 1) for name, kind in _KINDS.items()}
        if found != wanted or len({len(values) for values in stored.values()}) != 1:
            raise InputError(
                f"{path} holds {', '.join(found) or 'nothing'}; columns {', '.join(wanted)} of equal length were "
                "expected, make the recording again."
            )
        return cls(**{name: stored[name] for name in _KINDS})


class SensorScan(NamedTuple):
    """Returns of one scan in the frame of the vehicle that carried the sensor.

    Parameters
    ----------
    time_s : (N,) ndarray
        Time of each return [s].
    xyz : (N, 3) ndarray
        Places: forward, left, up [m], each in the frame of the vehicle at its own time.
    sensor : (3,) ndarray
        Place of the sensor in that frame [m].
    """

    time_s: FloatArray
    xyz: FloatArray
    sensor: FloatArray
