"""Calibration boards: chessboards and ChArUco boards, and their corners in an image."""

from dataclasses import dataclass
from typing import Any, NamedTuple, Protocol

import cv2
import numpy as np

from survey.core.arrays import FloatArray
from survey.core.errors import ConfigError
from survey.data.frames import Image

_SEARCHED_PX = 1600  # chessboards are searched in images of this width, and refined in the full ones
_LEAST_CORNERS = 8


class BoardView(NamedTuple):
    """Corners of a board in one image: places on the board (K, 2) [m], and pixels (K, 2)."""

    board: FloatArray
    pixels: FloatArray


class Board(Protocol):
    """Calibration board."""

    def detect(self, grey: Image) -> BoardView | None:
        """Return the board's corners in a grey image; None where it is not found."""
        ...


@dataclass(frozen=True)
class Chessboard:
    """Chessboard of ``columns`` × ``rows`` inner corners.

    Parameters
    ----------
    columns, rows : int
        Inner corners, one less than squares in each direction.
    square_m : float
        Side of a square [m]; the calibration does not depend on it.

    Raises
    ------
    ConfigError
        Fewer than 3 corners in a direction, or a square of no size.
    """

    columns: int
    rows: int
    square_m: float = 0.025

    def __post_init__(self) -> None:
        if min(self.columns, self.rows) < 3 or not self.square_m > 0.0:
            raise ConfigError(
                f"a board of {self.columns} × {self.rows} inner corners of {self.square_m:g} m was named; at least "
                "3 × 3 corners and squares above 0 were expected."
            )

    def detect(self, grey: Image) -> BoardView | None:
        """Return the board's corners in a grey image; None where not all of them are found.

        Parameters
        ----------
        grey : (H, W) ndarray of uint8
            The image.

        Returns
        -------
        BoardView or None
            All corners, to a small part of a pixel.
        """
        factor = min(_SEARCHED_PX / grey.shape[1], 1.0)
        small = (
            cv2.resize(grey, None, fx=factor, fy=factor, interpolation=cv2.INTER_AREA)
            if factor < 1.0
            else grey
        )
        size, exact = (self.columns, self.rows), cv2.CALIB_CB_ACCURACY
        found, corners = cv2.findChessboardCornersSB(small, size, flags=exact)
        if not found:
            found, corners = cv2.findChessboardCornersSB(small, size, flags=exact | cv2.CALIB_CB_EXHAUSTIVE)
        if not found:
            return None
        pixels = (np.asarray(corners, dtype=np.float64).reshape(-1, 2) + 0.5) / factor - 0.5
        if factor < 1.0:
            pixels = _refined(grey, pixels)
        places = np.mgrid[: self.columns, : self.rows].T.reshape(-1, 2) * self.square_m
        return BoardView(places.astype(np.float64), pixels)


@dataclass(frozen=True)
class CharucoBoard:
    """Chessboard with ArUco markers in its white squares; parts of it may be hidden.

    Parameters
    ----------
    columns, rows : int
        Squares in each direction.
    square_m, marker_m : float
        Sides of a square and of a marker [m]; the calibration depends on their ratio alone.
    dictionary : str
        OpenCV's dictionary of markers, without ``DICT_``: ``4X4_50``, ``5X5_100``, …

    Raises
    ------
    ConfigError
        Sizes that fit no board, or a dictionary that OpenCV does not have.
    """

    columns: int
    rows: int
    square_m: float
    marker_m: float
    dictionary: str = "4X4_50"

    def __post_init__(self) -> None:
        if min(self.columns, self.rows) < 3 or not 0.0 < self.marker_m < self.square_m:
            raise ConfigError(
                f"a ChArUco board of {self.columns} × {self.rows} squares of {self.square_m:g} m with markers of "
                f"{self.marker_m:g} m was named; at least 3 × 3 squares and smaller markers were expected."
            )
        if not hasattr(cv2.aruco, f"DICT_{self.dictionary}"):
            raise ConfigError(
                f"there is no dictionary of markers {self.dictionary!r}; name one of OpenCV's, such as 4X4_50 or 6X6_250."
            )

    @property
    def board(self) -> Any:
        """OpenCV's board."""
        dictionary = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, f"DICT_{self.dictionary}"))
        return cv2.aruco.CharucoBoard((self.columns, self.rows), self.square_m, self.marker_m, dictionary)

    def detect(self, grey: Image) -> BoardView | None:
        """Return the board's corners in a grey image; None where fewer than eight are found.

        Parameters
        ----------
        grey : (H, W) ndarray of uint8
            The image.

        Returns
        -------
        BoardView or None
            Corners that are seen between markers that are seen.
        """
        board = self.board
        corners, ids, _, _ = cv2.aruco.CharucoDetector(board).detectBoard(grey)
        if ids is None or len(ids) < _LEAST_CORNERS:
            return None
        places = np.asarray(board.getChessboardCorners(), dtype=np.float64)[np.asarray(ids).ravel(), :2]
        return BoardView(places, np.asarray(corners, dtype=np.float64).reshape(-1, 2))


def _refined(grey: Image, pixels: FloatArray) -> FloatArray:
    """Refine corners in the full image, within a third of the distance to their neighbours."""
    spacing = float(np.linalg.norm(np.diff(pixels, axis=0), axis=1).min())
    half = int(np.clip(spacing / 3.0, 3, 15))
    stop = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_MAX_ITER, 50, 1e-3)
    corners = np.ascontiguousarray(pixels[:, None, :], dtype=np.float32)
    found = cv2.cornerSubPix(grey, corners, (half, half), (-1, -1), stop)
    return np.asarray(found, dtype=np.float64).reshape(-1, 2)
