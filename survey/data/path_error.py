"""Gaussian posterior of the error of an estimated path, shared by its keyframes.

`PathError` holds the sparse information matrix Λ (inverse covariance) of a smoother. The covariance of linear functions W of
the error is W Λ⁻¹ Wᵀ. `SparseFactor` factorizes symmetric positive definite matrices once, and solves with them in blocks
of right-hand sides. `motion_rows` selects the unknowns of the ice's motion among those of a path.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, Self

import numpy as np
from scipy import sparse
from scipy.sparse.linalg import splu

from survey.core import DataObject, FloatArray, InputError, IntArray, checked
from survey.io.arrays_file import read_npz, write_npz

# Right-hand sides that are solved for at once: SuperLU takes two more arrays of their size, and slows down with many.
_SIDES_AT_ONCE = 64


@dataclass(frozen=True)
class SparseFactor:
    """Factorization of a symmetric positive definite matrix (S, S), to solve with.

    `factor`: of the matrix.

    >>> factor = SparseFactor.of(sparse.diags_array([2.0, 4.0]))
    >>> factor.solve(np.array([1.0, 1.0]))
    array([0.5 , 0.25])
    """

    factor: Any

    @classmethod
    def of(cls, matrix: Any) -> Self:
        """Factorize a sparse matrix."""
        options = {"SymmetricMode": True}
        return cls(
            splu(
                sparse.csc_matrix(matrix), permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options=options
            )
        )

    def solve(self, sides: FloatArray) -> FloatArray:
        """Return the solutions of one or several right-hand sides.

        `sides` (S,) or (S, R): right-hand sides.
        """
        if sides.ndim == 1:
            solved: FloatArray = self.factor.solve(sides)
            return solved
        result = np.empty(sides.shape, order="F")
        for first in range(0, sides.shape[1], _SIDES_AT_ONCE):
            here = slice(first, first + _SIDES_AT_ONCE)
            result[:, here] = self.factor.solve(np.asfortranarray(sides[:, here]))
        return result


POSE = 6
"""Unknowns that every keyframe has: error of easting, northing, elevation [m], yaw, pitch, roll [rad]."""

# Keyframes or functions whose covariances are found at once: bounds the memory of a long drive.
_AT_ONCE = 64


@dataclass(frozen=True, eq=False, repr=False)
class PathError(DataObject):
    r"""Gaussian posterior of a path's error, as the sparse information of a smoother.

    The unknowns are those of K keyframes, n each, then globals. The first six of a
    keyframe are the errors (estimated minus real) of its pose; the others and the globals
    (receiver bias, scale, …) matter only for what they tie together. Between keyframes
    the error is interpolated linearly. With the information Λ the covariance of any
    linear function of the error, given by rows W, is

    .. math::  W \Lambda^{-1} W^T

    Neighbouring keyframes share nearly all of it: to count each keyframe's marginal as
    independent is to assume that driving longer reduces an offset.

    Parameters
    ----------
    time_s : (K,) array_like
        Times of the keyframes [s], increasing.
    information : scipy.sparse array
        Λ, (K n + g, K n + g), symmetric positive definite.
    n_states : int
        n, at least 6.
    first_keyframes : sequence of int
        First keyframe of each drive, where the errors of several drives are joined.

    Raises
    ------
    InputError
        Shapes that do not fit together, NaN, fewer than two keyframes.

    Notes
    -----
    A linearisation about the estimated path: good while angles err by degrees and
    places by metres.

    Examples
    --------
    >>> stiff = sparse.identity(12, format="csr") * 4.0
    >>> error = PathError(np.array([0.0, 10.0]), stiff, 6)
    >>> rows = error.rows(np.array([0.5]), np.array([[0.0, 0.0, 1.0, 0.0, 0.0, 0.0]]))
    >>> error.covariance(rows)
    array([[0.125]])
    """

    time_s: FloatArray
    information: Any
    n_states: int = POSE
    first_keyframes: tuple[int, ...] = (0,)

    def __post_init__(self) -> None:
        times = checked(self.time_s, (None,), "the times of the keyframes")
        information = sparse.csr_array(self.information)
        size = information.shape[0]
        if len(times) < 2 or self.n_states < POSE or size < len(times) * self.n_states:
            raise InputError(
                f"the path's error has {len(times)} keyframes of {self.n_states} unknowns in a matrix of {size}; at least "
                f"2 keyframes of {POSE} are needed, and a row for each unknown."
            )
        if not np.isfinite(information.data).all():
            raise InputError("the information of the path's error holds NaN; localize again.")
        object.__setattr__(self, "time_s", times)
        object.__setattr__(self, "information", information)

    def __len__(self) -> int:
        return len(self.time_s)

    def _compared(self) -> dict[str, Any]:
        matrix = self.information.sorted_indices()
        parts = {name: getattr(matrix, name) for name in ("shape", "data", "indices", "indptr")}
        return {
            "time_s": self.time_s,
            "n_states": self.n_states,
            "first_keyframes": self.first_keyframes,
            **parts,
        }

    def _summary(self) -> str:
        return f"{len(self)} keyframes of {self.n_states} states, {self.n_unknowns} unknowns"

    @property
    def n_unknowns(self) -> int:
        """Number of unknowns, globals included."""
        return int(self.information.shape[0])

    @classmethod
    def joined(cls, errors: Sequence[Self]) -> Self:
        """Return the errors of several drives as one, without any correlation between drives.

        The keyframes of a drive follow those of the drive before it. Times of later drives are shifted, so that
        they increase; points name their keyframes, not times.

        Parameters
        ----------
        errors : sequence of PathError
            One for each drive, with equal numbers of unknowns per keyframe.

        Returns
        -------
        PathError
            The same object for one drive.

        Raises
        ------
        InputError
            Errors with different numbers of unknowns per keyframe.
        """
        if len(errors) == 1:
            return errors[0]
        n = errors[0].n_states
        if any(error.n_states != n for error in errors):
            raise InputError(
                f"the drives have {sorted({error.n_states for error in errors})} unknowns per keyframe; localize all of "
                "them with the same settings."
            )
        sizes = np.cumsum([0] + [len(error) for error in errors])
        begins = np.cumsum([0.0] + [error.time_s[-1] - error.time_s[0] + 1.0 for error in errors])
        times = [error.time_s - error.time_s[0] + begin for error, begin in zip(errors, begins, strict=False)]
        information = sparse.csr_array(sparse.block_diag([error.information for error in errors]))
        order = _keyframes_first([len(error) * n for error in errors], [error.n_unknowns for error in errors])
        joined = information[order][:, order]
        return cls(np.concatenate(times), joined, n, tuple(sizes[:-1].tolist()))

    @property
    def n_drives(self) -> int:
        """Number of drives whose errors are joined; 1 for the error of one path."""
        return len(self.first_keyframes)

    def drive_of(self, keyframe: FloatArray) -> IntArray:
        """Return the number of the drive that keyframes belong to.

        Parameters
        ----------
        keyframe : (N,) ndarray
            Places among the keyframes, as `keyframe_at` returns them.

        Returns
        -------
        (N,) ndarray of int
            Counted from 0.
        """
        drive: IntArray = np.searchsorted(self.first_keyframes, keyframe, side="right") - 1
        return drive

    def keyframe_at(self, time_s: FloatArray) -> FloatArray:
        """Return the place of times (N,) among the keyframes: 2.25 is a quarter of the way from the third to the fourth.

        Parameters
        ----------
        time_s : (N,) ndarray
            Times [s].

        Returns
        -------
        (N,) ndarray
            Places among the keyframes, 0 to K - 1.
        """
        return np.interp(time_s, self.time_s, np.arange(len(self), dtype=np.float64))

    def rows(self, keyframe: FloatArray, by_pose: FloatArray) -> Any:
        """Return the sparse rows W (N, unknowns) of functions ``by_pose · (e, n, u, yaw, pitch, roll)`` at keyframes.

        Parameters
        ----------
        keyframe : (N,) ndarray
            Where among the keyframes, as `keyframe_at` gives it.
        by_pose : (N, 6) ndarray
            Derivatives by the six errors of the pose there.

        Returns
        -------
        scipy.sparse.csr_array
            W, with twelve entries in each row.
        """
        before, share = self._split(keyframe)
        columns = (before[:, None] + np.array([0, 1]))[:, :, None] * self.n_states + np.arange(POSE)
        weights = np.stack([1.0 - share, share], axis=1)[:, :, None] * by_pose[:, None, :]
        row = np.broadcast_to(np.arange(len(before))[:, None, None], columns.shape)
        place = (row.ravel(), columns.ravel())
        return sparse.csr_array((weights.ravel(), place), shape=(len(before), self.n_unknowns))

    def _split(self, keyframe: FloatArray) -> tuple[IntArray, FloatArray]:
        """Return the keyframe before, and the share of the way to the next."""
        last = len(self) - 1
        if keyframe.size and not (keyframe.min() >= 0.0 and keyframe.max() <= last):
            raise InputError(
                f"points name keyframes from {keyframe.min():g} to {keyframe.max():g}, the path has 0 to {last}; "
                "points and path do not belong together."
            )
        before = np.minimum(np.floor(keyframe).astype(np.int64), last - 1)
        return before, keyframe - before

    @cached_property
    def _factor(self) -> SparseFactor:
        return SparseFactor.of(self.information)

    def solve(self, sides: FloatArray) -> FloatArray:
        """Return Λ⁻¹ times right-hand sides (unknowns,) or (unknowns, R).

        Parameters
        ----------
        sides : (unknowns,) or (unknowns, R) ndarray
            Right-hand sides.

        Returns
        -------
        ndarray
            Of the shape of `sides`.
        """
        return self._factor.solve(sides)

    def covariance(self, rows: Any) -> FloatArray:
        """Return the covariance (N, N) of linear functions of the error, given by sparse rows (N, unknowns).

        Parameters
        ----------
        rows : (N, unknowns) scipy.sparse array
            Derivatives of the functions, as `rows` returns them.

        Returns
        -------
        (N, N) ndarray
            In the product of the units of the functions.
        """
        blocks = [rows[first : first + _AT_ONCE] for first in range(0, max(rows.shape[0], 1), _AT_ONCE)]
        covariance: FloatArray = np.hstack([rows @ self.solve(block.toarray().T.copy()) for block in blocks])
        return 0.5 * (covariance + covariance.T)

    @cached_property
    def pose_covariances(self) -> tuple[FloatArray, FloatArray]:
        """Covariances (K, 6, 6) of each keyframe's pose, and (K - 1, 6, 6) of each with the next."""
        own, with_next = np.zeros((len(self), POSE, POSE)), np.zeros((len(self) - 1, POSE, POSE))
        for first in range(0, len(self), _AT_ONCE):
            here = np.arange(first, min(first + _AT_ONCE, len(self)))
            columns = (here[:, None] * self.n_states + np.arange(POSE)).ravel()
            sides = np.zeros((self.n_unknowns, len(columns)))
            sides[columns, np.arange(len(columns))] = 1.0
            solved = self.solve(sides)
            for j, k in enumerate(here):
                block = solved[:, POSE * j : POSE * (j + 1)]
                own[k] = block[k * self.n_states : k * self.n_states + POSE]
                if k:
                    with_next[k - 1] = block[(k - 1) * self.n_states : (k - 1) * self.n_states + POSE]
        return 0.5 * (own + own.transpose(0, 2, 1)), with_next

    def pose_covariance(self, keyframe: FloatArray) -> FloatArray:
        """Return the marginal covariance (N, 6, 6) of the pose's error at places among the keyframes.

        Parameters
        ----------
        keyframe : (N,) ndarray
            Places among the keyframes, as `keyframe_at` returns them.

        Returns
        -------
        (N, 6, 6) ndarray
            Of easting, northing, elevation [m], yaw, pitch and roll [rad].
        """
        before, share = self._split(keyframe)
        own, with_next = self.pose_covariances
        a, b = (1.0 - share)[:, None, None], share[:, None, None]
        across = a * b * with_next[before]
        result: FloatArray = a**2 * own[before] + b**2 * own[before + 1] + across + across.transpose(0, 2, 1)
        return result

    def write(self, path: str | Path) -> None:
        """Write one compressed ``.npz`` file; equal errors give equal bytes.

        Parameters
        ----------
        path : str or pathlib.Path
            Ends in ``.npz``.
        """
        upper = sparse.coo_array(sparse.triu(self.information))
        arrays = {
            "time_s": self.time_s,
            "n_states": self.n_states,
            "n_unknowns": self.n_unknowns,
            **({"first_keyframes": self.first_keyframes} if self.n_drives > 1 else {}),
            "row": upper.row.astype(np.int32),
            "column": upper.col.astype(np.int32),
            "value": upper.data,
        }
        write_npz(path, arrays)

    @classmethod
    def read(cls, path: str | Path) -> Self:
        """Read what `write` wrote.

        Parameters
        ----------
        path : str or pathlib.Path
            A file of `write`.

        Returns
        -------
        PathError
            Equal to the one written.

        Raises
        ------
        InputError
            The file is missing or damaged.
        """
        stored = read_npz(path, "the error of the path", "localize again")
        try:
            size = int(stored["n_unknowns"])
            place = (stored["row"], stored["column"])
            upper = sparse.csr_array((stored["value"], place), shape=(size, size))
            time_s, n_states = stored["time_s"], int(stored["n_states"])
            first = tuple(np.asarray(stored.get("first_keyframes", [0])).tolist())
        except (ValueError, KeyError) as error:
            raise InputError(f"{path} is no error of a path ({error}); localize again.") from error
        return cls(time_s, upper + sparse.triu(upper, k=1).T, n_states, first)


def _keyframes_first(n_of_keyframes: list[int], n_unknowns: list[int]) -> IntArray:
    """Return the order that puts the unknowns of all keyframes before the globals of all drives."""
    begins = np.cumsum([0, *n_unknowns[:-1]])
    keyframes = [begin + np.arange(n) for begin, n in zip(begins, n_of_keyframes, strict=True)]
    others = [
        begin + np.arange(n, size) for begin, n, size in zip(begins, n_of_keyframes, n_unknowns, strict=True)
    ]
    order: IntArray = np.concatenate([*keyframes, *others])
    return order


def motion_rows(path: PathError, n_unknowns: int, n_columns: int | None = None) -> Any:
    """Return the sparse rows (R, columns) that pick the unknowns of the ice's motion among those of a path."""
    every = np.arange(n_unknowns)
    place = (every, len(path) * path.n_states + every)
    shape = (n_unknowns, path.n_unknowns if n_columns is None else n_columns)
    return sparse.csr_array((np.ones(n_unknowns), place), shape=shape)
