r"""Batch smoother: the slowly growing error of the odometry, told from GPS and barometer.

At nodes k along the path the unknowns are the errors (estimated minus real) of position
e, yaw ψ and pitch θ, the GPS bias b and the barometer's drift c; the odometry's scale s
and the barometer's datum c₀ are common to all. With L the travel between nodes, t the
time, and (u, v) = how the step answers to yaw and pitch:

    e_{k+1} − e_k  = ψ̄ u + θ̄ v + s d + w,           w ~ N(0, q² L)
    ψ_{k+1}        = a ψ_k + n,   a = exp(−L/Λ),      n ~ N(0, σ_ψ² (1 − a²))      and θ alike
    p̃_k − z_k      = e_k − b_k + ν                     (GPS, ν white, b Gauss–Markov in time)
    p̃_{z,k} − h_k  = e_{z,k} − c_k − c₀ + ν            (barometer)

All are linear with Gaussian noise, so one sparse least-squares solve gives the exact
posterior under the model; its covariance is the one that is reported.
"""

from dataclasses import dataclass, field

import numpy as np
from scipy import sparse

from survey.arrays import FloatArray, IntArray
from survey.recording import Recording
from vision_slam.chain import solve_chain
from vision_slam.config import LocalizationConfig
from vision_slam.rotation import turned

_PER_NODE = 9
_E, _YAW, _PITCH, _BIAS, _DRIFT = 0, 3, 4, 5, 8
_SCALE, _DATUM = -2, -1
_DATUM_SIGMA_M = 1e4  # a barometer's datum is unknown by kilometres before the first reading


@dataclass(frozen=True)
class SmoothedPath:
    """Corrected poses and what is still unknown of them.

    ``position`` (N, 3) [m], ``attitude_rad`` (N, 3) roll, pitch, yaw, ``covariance``
    (N, 5, 5) of position, yaw and pitch [m, rad].
    """

    position: FloatArray
    attitude_rad: FloatArray
    covariance: FloatArray


def smooth(recording: Recording, reckoned: FloatArray, config: LocalizationConfig) -> SmoothedPath:
    """Correct a dead-reckoned path (N, 3) [m] by the recording's GPS and barometer."""
    assert recording.odometry is not None
    nodes = _nodes(reckoned, config.node_spacing_m)
    system = _System(len(nodes))
    _add_start(system, config)
    _add_odometry(system, recording, reckoned, nodes, config)
    _add_gps(system, recording, reckoned, nodes, config)
    _add_barometer(system, recording, reckoned, nodes, config)
    error, covariance = system.solve()
    return _corrected(recording, reckoned, nodes, error, covariance)


@dataclass
class _System:
    """Rows of a whitened linear least-squares system, gathered term by term."""

    n_nodes: int
    rows: list[IntArray] = field(default_factory=list)
    columns: list[IntArray] = field(default_factory=list)
    entries: list[FloatArray] = field(default_factory=list)
    right: list[FloatArray] = field(default_factory=list)
    n_rows: int = 0

    @property
    def n_unknowns(self) -> int:
        return self.n_nodes * _PER_NODE + 2

    def add(self, terms: list[tuple[IntArray, FloatArray]], value: FloatArray, sigma: FloatArray) -> None:
        """Add rows ``Σ coefficient · unknown = value ± sigma``; all arrays have one entry a row."""
        n = len(value)
        row = self.n_rows + np.arange(n)
        for column, coefficient in terms:
            self.rows.append(row)
            self.columns.append(np.broadcast_to(column, n) % self.n_unknowns)
            self.entries.append(coefficient / sigma)
        self.right.append(value / sigma)
        self.n_rows += n

    def solve(self) -> tuple[FloatArray, FloatArray]:
        """Return the estimate at the nodes (K, 9) and the covariance (K, 5, 5) of e, ψ, θ."""
        place = (np.concatenate(self.rows), np.concatenate(self.columns))
        shape = (self.n_rows, self.n_unknowns)
        design = sparse.csr_array((np.concatenate(self.entries), place), shape=shape)
        information = sparse.coo_array(design.T @ design)
        estimate, covariance = solve_chain(
            information, design.T @ np.concatenate(self.right), _PER_NODE, self.n_nodes
        )
        return estimate, covariance[:, :5, :5]


def _nodes(path: FloatArray, spacing_m: float) -> IntArray:
    """Return indices of poses about `spacing_m` apart, first and last included."""
    travel = np.r_[0.0, np.cumsum(np.linalg.norm(np.diff(path, axis=0), axis=1))]
    n = max(2, round(travel[-1] / spacing_m) + 1)
    return np.unique(np.searchsorted(travel, np.linspace(0.0, travel[-1], n) - 1e-9).clip(0, len(path) - 1))


def _unknown(nodes: IntArray | int, which: int) -> IntArray:
    return np.asarray(nodes, dtype=np.int64) * _PER_NODE + which


def _add_start(system: _System, config: LocalizationConfig) -> None:
    one = np.ones(1)
    for axis in range(3):
        system.add([(_unknown(0, _E + axis), one)], 0.0 * one, config.start_sigma_m * one)
    system.add([(_unknown(0, _YAW), one)], 0.0 * one, np.radians(config.yaw_sigma_deg) * one)
    system.add([(_unknown(0, _PITCH), one)], 0.0 * one, np.radians(config.tilt_sigma_deg) * one)
    system.add([(np.array(_SCALE), one)], 0.0 * one, config.scale_sigma * one)
    system.add([(np.array(_DATUM), one)], 0.0 * one, _DATUM_SIGMA_M * one)


def _add_odometry(
    system: _System, recording: Recording, reckoned: FloatArray, nodes: IntArray, config: LocalizationConfig
) -> None:
    assert recording.odometry is not None
    before = np.arange(len(nodes) - 1)
    step = np.diff(reckoned[nodes], axis=0)
    length = _travel_between(reckoned, nodes)
    by_yaw, by_pitch = _leverage(recording.odometry.attitude_rad, reckoned, nodes)
    one = np.ones(len(before))
    for axis in range(3):
        terms = [(_unknown(before + 1, _E + axis), one), (_unknown(before, _E + axis), -one)]
        for k in (before, before + 1):
            terms.append((_unknown(k, _YAW), -0.5 * by_yaw[:, axis]))
            terms.append((_unknown(k, _PITCH), -0.5 * by_pitch[:, axis]))
        terms.append((np.array(_SCALE), -step[:, axis]))
        system.add(terms, 0.0 * one, config.step_sigma_m * np.sqrt(length))
    memory = np.exp(-length / config.attitude_correlation_m)
    for which, sigma_deg in ((_YAW, config.yaw_sigma_deg), (_PITCH, config.tilt_sigma_deg)):
        _add_gauss_markov(system, which, memory, np.radians(sigma_deg))


def _travel_between(path: FloatArray, nodes: IntArray) -> FloatArray:
    travel = np.r_[0.0, np.cumsum(np.linalg.norm(np.diff(path, axis=0), axis=1))]
    return np.diff(travel[nodes])


def _leverage(attitude_rad: FloatArray, path: FloatArray, nodes: IntArray) -> tuple[FloatArray, FloatArray]:
    """How the step between nodes answers to yaw and pitch errors, summed over the poses between."""
    by_yaw, by_pitch = turned(np.diff(path, axis=0), attitude_rad[:-1, 2])
    total = [np.vstack([np.zeros(3), np.cumsum(answers, axis=0)]) for answers in (by_yaw, by_pitch)]
    return np.diff(total[0][nodes], axis=0), np.diff(total[1][nodes], axis=0)


def _add_gauss_markov(system: _System, which: int, memory: FloatArray, sigma: float) -> None:
    """Tie an unknown to its neighbour: x_{k+1} = memory · x_k + noise that keeps its variance."""
    before = np.arange(len(memory))
    terms = [(_unknown(before + 1, which), np.ones(len(memory))), (_unknown(before, which), -memory)]
    system.add(terms, np.zeros(len(memory)), sigma * np.sqrt(np.maximum(1.0 - memory**2, 1e-12)))


def _add_gps(
    system: _System, recording: Recording, reckoned: FloatArray, nodes: IntArray, config: LocalizationConfig
) -> None:
    assert recording.odometry is not None
    time_s = recording.odometry.time_s
    at_fix = np.column_stack([np.interp(recording.gps.time_s, time_s, column) for column in reckoned.T])
    antenna = recording.gps.position - [0.0, 0.0, recording.antenna_height_m]
    node, mean, count = _averaged(recording.gps.time_s, at_fix - antenna, time_s[nodes])
    memory = np.exp(-np.diff(time_s[nodes]) / config.gps_correlation_time_s)
    one = np.ones(1)
    for axis in range(3):
        factor = config.gps_vertical_factor if axis == 2 else 1.0
        terms = [
            (_unknown(node, _E + axis), np.ones(len(node))),
            (_unknown(node, _BIAS + axis), -np.ones(len(node))),
        ]
        system.add(terms, mean[:, axis], factor * config.gps_white_sigma_m / np.sqrt(count))
        bias_sigma = factor * config.gps_bias_sigma_m
        system.add([(_unknown(0, _BIAS + axis), one)], 0.0 * one, bias_sigma * one)
        _add_gauss_markov(system, _BIAS + axis, memory, bias_sigma)


def _add_barometer(
    system: _System, recording: Recording, reckoned: FloatArray, nodes: IntArray, config: LocalizationConfig
) -> None:
    assert recording.odometry is not None
    one = np.ones(1)
    time_s = recording.odometry.time_s
    memory = np.exp(-np.diff(time_s[nodes]) / config.barometer_correlation_time_s)
    system.add([(_unknown(0, _DRIFT), one)], 0.0 * one, config.barometer_drift_sigma_m * one)
    _add_gauss_markov(system, _DRIFT, memory, config.barometer_drift_sigma_m)
    if recording.barometer is None:
        return
    height = np.interp(recording.barometer.time_s, time_s, reckoned[:, 2])
    residual = (height - recording.barometer.height_m)[:, None]
    node, mean, count = _averaged(recording.barometer.time_s, residual, time_s[nodes])
    many = np.ones(len(node))
    terms = [(_unknown(node, _E + 2), many), (_unknown(node, _DRIFT), -many), (np.array(_DATUM), -many)]
    system.add(terms, mean[:, 0], config.barometer_white_sigma_m / np.sqrt(count))


def _averaged(
    time_s: FloatArray, values: FloatArray, node_time_s: FloatArray
) -> tuple[IntArray, FloatArray, FloatArray]:
    """Average readings (N, D) at their nearest nodes: node index, mean (K, D), count (K,)."""
    edges = 0.5 * (node_time_s[1:] + node_time_s[:-1])
    nearest = np.searchsorted(edges, time_s)
    node, inverse, count = np.unique(nearest, return_inverse=True, return_counts=True)
    total = np.zeros((len(node), values.shape[1]))
    np.add.at(total, inverse, values)
    return node.astype(np.int64), total / count[:, None], count.astype(np.float64)


def _corrected(
    recording: Recording, reckoned: FloatArray, nodes: IntArray, error: FloatArray, covariance: FloatArray
) -> SmoothedPath:
    assert recording.odometry is not None
    time_s = recording.odometry.time_s
    spread = np.column_stack([np.interp(time_s, time_s[nodes], column) for column in error[:, :5].T])
    attitude = recording.odometry.attitude_rad.copy()
    attitude[:, 2] -= spread[:, _YAW]
    attitude[:, 1] -= spread[:, _PITCH]
    between = np.column_stack(
        [np.interp(time_s, time_s[nodes], entry) for entry in covariance.reshape(-1, 25).T]
    )
    return SmoothedPath(reckoned - spread[:, :3], attitude, between.reshape(-1, 5, 5))
