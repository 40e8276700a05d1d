"""Rows of a whitened linear least-squares system over a path's nodes, gathered term by term."""

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from scipy import sparse

from survey.arrays import FloatArray, IntArray

PER_NODE = 11
"""Unknowns of a node: position (3), yaw, pitch, roll, GPS bias (3), drift of the barometer, scale of the odometry."""
E, YAW, PITCH, ROLL, BIAS, DRIFT, SCALE = 0, 3, 4, 5, 6, 9, 10
MEAN_SCALE, WHEEL_SCALE, SKID, DATUM, HEADING, PITCH_BIAS, ROLL_BIAS, FORCE_PITCH, FORCE_ROLL = range(-9, 0)
"""Unknowns that all nodes share, counted from the end."""
N_GLOBALS = 9

Term = tuple[IntArray, FloatArray]


@dataclass
class NormalEquations:
    """Rows ``Σ coefficient · unknown = value ± sigma``, and what they amount to."""

    n_nodes: int
    rows: list[IntArray] = field(default_factory=list)
    columns: list[IntArray] = field(default_factory=list)
    entries: list[FloatArray] = field(default_factory=list)
    right: list[FloatArray] = field(default_factory=list)
    log_sigma: float = 0.0
    n_rows: int = 0

    @property
    def n_unknowns(self) -> int:
        """Number of unknowns, globals included."""
        return self.n_nodes * PER_NODE + N_GLOBALS

    def add(self, terms: list[Term], value: FloatArray, sigma: FloatArray) -> None:
        """Add rows; a term's columns and coefficients have one entry a row, or one for all."""
        n = len(value)
        row = self.n_rows + np.arange(n)
        for column, coefficient in terms:
            self.rows.append(row)
            self.columns.append(np.broadcast_to(column, n) % self.n_unknowns)
            self.entries.append(coefficient / sigma)
        self.right.append(value / sigma)
        self.log_sigma += float(np.log(np.broadcast_to(sigma, n)).sum())
        self.n_rows += n

    def add_prior(self, which: IntArray | int, sigma: float) -> None:
        """Say of one unknown that it is 0 ± sigma."""
        one = np.ones(1)
        self.add([(np.atleast_1d(np.asarray(which)), one)], 0.0 * one, sigma * one)

    def add_gauss_markov(
        self,
        which: int,
        memory: FloatArray,
        sigma: float,
        mean: int | None = None,
        jump: FloatArray | float = 0.0,
    ) -> None:
        """Tie an unknown to its neighbour: x' − μ = memory · (x − μ) + noise that keeps the variance; μ is a global.

        Noise of the standard deviation `jump`, of its own between each two nodes, comes on top.
        """
        before = np.arange(len(memory))
        first, one = np.zeros(1, dtype=np.int64), np.ones(1)
        steps: list[Term] = [
            (unknown(before + 1, which), np.ones(len(memory))),
            (unknown(before, which), -memory),
        ]
        start: list[Term] = [(unknown(first, which), one)]
        if mean is not None:
            steps.append((np.array(mean), memory - 1.0))
            start.append((np.array(mean), -one))
        kept = sigma * np.sqrt(np.maximum(1.0 - memory**2, 1e-12))
        self.add(steps, np.zeros(len(memory)), np.hypot(kept, jump))
        self.add(start, 0.0 * one, sigma * one)

    @property
    def design(self) -> Any:
        """The whitened rows, sparse."""
        place = (np.concatenate(self.rows), np.concatenate(self.columns))
        return sparse.csr_array((np.concatenate(self.entries), place), shape=(self.n_rows, self.n_unknowns))

    @property
    def values(self) -> FloatArray:
        """The whitened right-hand side."""
        return np.concatenate(self.right)


def unknown(nodes: IntArray | int, which: int) -> IntArray:
    """Return the column of one unknown of some nodes."""
    return np.asarray(nodes, dtype=np.int64) * PER_NODE + which
