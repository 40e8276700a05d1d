"""Batch smoother: sparse least squares for the slowly varying errors of the odometry.

At nodes k along the path the unknowns are the errors (estimated minus real) of position
e, yaw ψ, of its slow part η, pitch θ, roll φ and scale s, the GPS bias b, the barometer's
drift c and the gyro's bias β; the constant parts of pitch, roll and scale, the wheels' scale
ω and skidding χ, the accelerometer's bias a and the barometer's datum c₀ are common to all, and so is
the delay τ of the fixes where their clock may differ from that of the odometry.
With L the travel between nodes, t the time, and (u, v) the derivatives of the step by yaw and
pitch:

    e_{k+1} − e_k  = ψ̄ u + θ̄ v + s̄ d + w,           w ~ N(0, q² L + q_t² |Δψ|)
    θ_{k+1} − κ    = a (θ_k − κ) + n,  a = exp(−L/Λ)  n ~ N(0, σ_θ² (1 − a²));  φ, s, ψ about η alike
    η_{k+1} − η_k  = n                                (walk of the heading of visual odometry)
    g_k            = β̄ Δt − (ψ_{k+1} − ψ_k) + ν       (turn of the gyro beyond the odometry's)
    W_k − D_k      = D_k (ω − s̄) + χ |Δψ| + ν          (travel of the wheels, D that of the odometry,
                                                        both back again where the rover reverses)
    p̃_k − z_k      = e_k − b_k + τ v_k + ν             (GPS, ν white, b Gauss–Markov in time, v the velocity)
    p̃_{z,k} − h_k  = e_{z,k} − c_k − c₀ + ν            (barometer)
    θ̃_k − θ(g)_k   = θ_k − a_θ + ν                     (gravity; roll alike)

The changing part of roll and pitch of images is a tilt of the levelled frame, which stays in the world while the body turns by
Δψ between nodes: (φ, θ)_{k+1} = a R(Δψ) (φ, θ)_k + n about their constant parts, with the rotation R. On turning drives
their errors change within metres otherwise.

Gravity bounds the errors of roll and pitch; the heading of images is unbounded. Odometry that
was levelled by the same accelerometer contains its readings: these rows are left out, so that no
reading counts twice. All noise is Gaussian, and all equations are linear but for the rotation of
the steps, which is linearized again until the heading converges: a sparse least-squares solve
gives the posterior. The full information matrix is returned with the path, so that maps can use
its correlations.

`delay_moments` is the posterior of the delay under a mixture prior of one clock or two. `place_landmarks` transforms
sightings in the body frame to surface points in the world, with the covariance of sighting and path.
"""

import logging
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy import sparse

from survey import InputError, SurfacePoints, Trajectory
from survey.core import FloatArray, IntArray
from survey.data.ice_motion import IceMotion
from survey.data.landmarks import most_informative
from survey.data.path_error import POSE, PathError, motion_rows
from survey.data.recording import OdometryRecording
from survey.data.sensors.odometry import Odometry
from vision_slam.attitude import quaternions, rotations
from vision_slam.config import LocalizationConfig
from vision_slam.fusion.error_terms import Nodes, add_terms
from vision_slam.fusion.normal_equations import (
    DELAY,
    PER_NODE,
    PITCH,
    ROLL,
    YAW,
    BlockTridiagonal,
    E,
    NormalEquations,
)
from vision_slam.fusion.pose_constraints import (
    PoseConstraints,
    gate_constraints,
    pose_constraints,
    pose_jacobian,
)

logger = logging.getLogger(__name__)

_LONGER = 4.0
# Twice this is the 99.9 % point of a likelihood ratio with one degree of freedom.
_CONVINCING = 5.4
# A swath of 600 m that turns by less bends by 2 cm; beyond that steps answer differently about the path that was found.
_BENT_RAD = np.radians(0.5)
# Fixes are compared with the path at their delayed time; a delay that changes by less bends it by millimetres.
_LATER_S = 0.01
_MOST_PASSES = 5
_MOST_NODES = 2000
# Nodes that a turn of one radian asks for, besides those for travel.
_NODES_PER_RAD = 0.5


@dataclass(frozen=True)
class SmoothedPath:
    """Smoothed poses with their joint posterior.

    ``position`` (N, 3) [m], ``attitude_rad`` (N, 3) roll, pitch, yaw, ``covariance``
    (N, 6, 6) of position, yaw, pitch and roll [m, rad], ``error`` the joint posterior of
    the keyframes, ``n_constraints`` and ``n_refused`` the numbers of stakes and loop closures
    used and refused, ``gps_evidence`` the gain in log likelihood of a GPS correlation time
    four times as long as assumed, ``delay_s`` and ``delay_sigma_s`` the delay of the fixes and its
    standard deviation [s], 0 where one clock stamps fixes and odometry, ``ice_motion`` the motion of the ice after
    all sensors, where the recording was reduced by one.
    """

    position: FloatArray
    attitude_rad: FloatArray
    covariance: FloatArray
    error: PathError
    n_constraints: int = 0
    n_refused: int = 0
    gps_evidence: float = 0.0
    delay_s: float = 0.0
    delay_sigma_s: float = 0.0
    ice_motion: IceMotion | None = None

    def trajectory(self, recording: OdometryRecording) -> Trajectory:
        """Return the poses as a trajectory."""
        return Trajectory(
            recording.odometry.time_s,
            self.position,
            quaternions(self.attitude_rad),
            self.covariance[:, :3, :3],
            recording.crs,
            error=self.error,
        )


def smooth(
    recording: OdometryRecording, dead_reckoned: FloatArray, config: LocalizationConfig
) -> SmoothedPath:
    """Smooth a dead-reckoned path (N, 3) [m] with all other sensors of the recording."""
    nodes = _nodes(dead_reckoned, recording.odometry, config)
    time_s = recording.odometry.time_s[nodes]
    posterior = _Posterior.of(recording, dead_reckoned, nodes, config)
    gain = _gain_if_longer(recording, dead_reckoned, nodes, config, posterior.log_evidence)
    if config.clock_sigma_s > 0.0:
        mean_s, sigma_s = delay_moments(*posterior.delay(config), config.clock_sigma_s)
        if mean_s == 0.0:
            posterior = _Posterior.of(recording, dead_reckoned, nodes, config, is_delay_linear=True)
        posterior = posterior.with_delay(mean_s, sigma_s)
    constraints = pose_constraints(recording, dead_reckoned, time_s, posterior.chain.n_unknowns, config)
    accepted = gate_constraints(constraints, posterior.chain, posterior.estimate, config.tie_gate)
    posterior = posterior.with_constraints(accepted)
    if len(constraints) > len(accepted):
        logger.warning(
            "%d of %d loop closures and stakes disagree with all other sensors and are left out",
            len(constraints) - len(accepted),
            len(constraints),
        )
    path = _corrected(recording, dead_reckoned, nodes, posterior)
    delay_s, delay_sigma_s = posterior.delay(config)
    return replace(
        path,
        n_constraints=len(accepted),
        n_refused=len(constraints) - len(accepted),
        gps_evidence=gain,
        delay_s=delay_s,
        delay_sigma_s=delay_sigma_s,
    )


def log_evidence(
    recording: OdometryRecording, dead_reckoned: FloatArray, config: LocalizationConfig
) -> float:
    """Return the log evidence of all sensors except stakes and loop closures, to compare configurations.

    Only configurations with the same nodes can be compared, see `node_spacing_m`.
    """
    nodes = _nodes(dead_reckoned, recording.odometry, config)
    return _Posterior.of(recording, dead_reckoned, nodes, config).log_evidence


@dataclass(frozen=True)
class _Posterior:
    """Estimate (n,), sparse information, its factorization, and the gain of the constraints."""

    chain: BlockTridiagonal
    information: sparse.csr_array
    estimate: FloatArray
    log_evidence: float
    gained: tuple[FloatArray, FloatArray] | None = None

    @classmethod
    def of(
        cls,
        recording: OdometryRecording,
        dead_reckoned: FloatArray,
        nodes: IntArray,
        config: LocalizationConfig,
        is_delay_linear: bool = False,
    ) -> "_Posterior":
        guess, delay_s = np.zeros((len(nodes), PER_NODE)), 0.0
        for _ in range(_MOST_PASSES):
            along = Nodes(recording.odometry, dead_reckoned, nodes, guess, delay_s)
            found = cls._about(recording, along, config)
            estimate = found.estimate[: guess.size].reshape(guess.shape)
            found_s = 0.0 if is_delay_linear else found.delay(config)[0]
            is_straight = np.abs(estimate - guess)[:, YAW].max() < _BENT_RAD
            if is_straight and abs(found_s - delay_s) < _LATER_S:
                break
            guess, delay_s = estimate, found_s
        return found

    @classmethod
    def _about(cls, recording: OdometryRecording, along: Nodes, config: LocalizationConfig) -> "_Posterior":
        motion = recording.ice_motion
        n_motion = 0 if motion is None else motion.n_unknowns
        system = NormalEquations(len(along.index), has_delay=config.clock_sigma_s > 0.0, n_motion=n_motion)
        add_terms(system, recording, along, config)
        design, values = system.design, system.values
        information = sparse.csr_array(design.T @ design)
        chain = BlockTridiagonal.of(sparse.coo_array(information), PER_NODE, system.n_nodes)
        right = design.T @ values
        estimate = chain.solve(right[:, None])[:, 0]
        misfit = float(values @ values - right @ estimate)
        log_evidence = -0.5 * (misfit + chain.log_determinant) - system.log_sigma
        return cls(chain, information, estimate, log_evidence)

    @cached_property
    def covariance(self) -> FloatArray:
        """Marginal covariances (K, 6, 6) of the poses."""
        own = self.chain.covariances()[0][:, :POSE, :POSE]
        if self.gained is None:
            return own
        gain, seen = (
            part[: len(own) * PER_NODE].reshape(len(own), PER_NODE, -1)[:, :POSE] for part in self.gained
        )
        left: FloatArray = own - gain @ seen.transpose(0, 2, 1)
        return 0.5 * (left + left.transpose(0, 2, 1))

    def with_delay(self, mean_s: float, sigma_s: float) -> "_Posterior":
        """Return the posterior with another marginal of the delay; all else given the delay stays as it is."""
        one = np.zeros((self.chain.n_unknowns, 1))
        one[DELAY] = 1.0
        answer = self.chain.solve(one)[:, 0]
        variance = float(answer[DELAY])
        estimate = self.estimate + answer * (mean_s - self.estimate[DELAY]) / variance
        n = self.chain.n_unknowns
        gained = np.array([sigma_s**-2.0 - 1.0 / variance])
        added = sparse.csr_array((gained, ([n + DELAY], [n + DELAY])), shape=(n, n))
        information = sparse.csr_array(self.information + added)
        chain = BlockTridiagonal.of(sparse.coo_array(information), PER_NODE, len(self.chain.inverses))
        return replace(self, chain=chain, information=information, estimate=estimate)

    def delay(self, config: LocalizationConfig) -> tuple[float, float]:
        """Return the delay of the fixes and its standard deviation [s]; 0 where it is no unknown."""
        if config.clock_sigma_s == 0.0:
            return 0.0, 0.0
        one = np.zeros((self.chain.n_unknowns, 1))
        one[DELAY] = 1.0
        return float(self.estimate[DELAY]), float(np.sqrt(self.chain.solve(one)[DELAY, 0]))

    def with_constraints(self, constraints: PoseConstraints) -> "_Posterior":
        """Return the posterior with stakes and loop closures (Woodbury over the factorization)."""
        if not len(constraints):
            return self
        seen = self.chain.solve(constraints.rows.T.toarray())
        gain = np.linalg.solve(constraints.rows @ seen + constraints.noise, seen.T).T
        estimate = self.estimate + gain @ (constraints.value - constraints.rows @ self.estimate)
        weighted = sparse.csr_array(np.linalg.inv(constraints.noise)) @ constraints.rows
        information = sparse.csr_array(self.information + constraints.rows.T @ weighted)
        return replace(self, information=information, estimate=estimate, gained=(gain, seen))


def _nodes(path: FloatArray, odometry: Odometry, config: LocalizationConfig) -> IntArray:
    """Return indices of poses about a spacing apart, with first, last and both ends of unmeasured steps.

    Errors of roll and pitch that stay in the world change with the heading, so that turns have more nodes.
    """
    travel = np.r_[0.0, np.cumsum(np.linalg.norm(np.diff(path, axis=0), axis=1))]
    if travel[-1] == 0.0:
        raise InputError(
            f"the odometry measures no motion from the first to the last of {len(path)} poses; "
            "record the wheels too, or leave out the images before the rover moves."
        )
    spacing_m = node_spacing_m(float(travel[-1]), config)
    if config.tilt_stays_in_world:
        turned = np.abs(np.diff(np.unwrap(odometry.attitude_rad[:, 2])))
        travel[1:] += _NODES_PER_RAD * spacing_m * np.cumsum(turned)
    n = max(2, round(travel[-1] / spacing_m) + 1)
    even = np.searchsorted(travel, np.linspace(0.0, travel[-1], n) - 1e-9).clip(0, len(path) - 1)
    unmeasured = np.flatnonzero(np.zeros(1) if odometry.step_sigma_m is None else odometry.step_sigma_m)
    return np.unique(np.concatenate([even, unmeasured, unmeasured + 1]))


def node_spacing_m(length_m: float, config: LocalizationConfig) -> float:
    """Return the travel between nodes, shorter than configured where fixes are precise.

    A fix counts as of the nearest node. Over half a spacing the error of the odometry shall vary
    by less than half the white error of a fix. Odometry of constant scale from a surveyed start has
    the configured spacing.
    """
    if config.scale_wander_sigma == 0.0 and config.start == "surveyed":
        return config.node_spacing_m
    per_m = config.step_sigma_m**2 + 2.0 * config.scale_wander_m * config.scale_wander_sigma**2
    precise_m = 0.5 * config.gps_white_sigma_m**2 / per_m
    return min(config.node_spacing_m, max(precise_m, length_m / _MOST_NODES))


def _gain_if_longer(
    recording: OdometryRecording,
    dead_reckoned: FloatArray,
    nodes: IntArray,
    config: LocalizationConfig,
    log_evidence: float,
) -> float:
    """Return the log likelihood gained by a GPS correlation time four times as long.

    A correlation time assumed too short makes all covariances too small, which shows in
    correlated innovations. One assumed too long costs little.
    """
    longer = config.gps_correlation_time_s * _LONGER
    changed = config.model_copy(update={"gps_correlation_time_s": longer})
    gain = _Posterior.of(recording, dead_reckoned, nodes, changed).log_evidence - log_evidence
    if gain > _CONVINCING:
        logger.warning(
            "the errors of the GPS have a longer correlation time than the %g s assumed (a log likelihood of %.0f more at %g s); "
            "raise localization.gps_correlation_time_s, or the claimed errors of path and map are too small",
            config.gps_correlation_time_s,
            gain,
            longer,
        )
    return gain


def _corrected(
    recording: OdometryRecording, dead_reckoned: FloatArray, nodes: IntArray, posterior: _Posterior
) -> SmoothedPath:
    time_s = recording.odometry.time_s
    error = posterior.estimate[: len(nodes) * PER_NODE].reshape(len(nodes), PER_NODE)[:, :POSE]
    spread = np.column_stack([np.interp(time_s, time_s[nodes], column) for column in error.T])
    attitude = recording.odometry.attitude_rad - spread[:, [ROLL, PITCH, YAW]]
    between = np.column_stack(
        [np.interp(time_s, time_s[nodes], entry) for entry in posterior.covariance.reshape(-1, POSE**2).T]
    )
    path_error = PathError(time_s[nodes], posterior.information, PER_NODE)
    return SmoothedPath(
        dead_reckoned - spread[:, E : E + 3],
        attitude,
        between.reshape(-1, POSE, POSE),
        path_error,
        ice_motion=_moved_poses(recording.ice_motion, posterior.estimate, path_error),
    )


def _moved_poses(motion: IceMotion | None, estimate: FloatArray, error: PathError) -> IceMotion | None:
    """Return the motion of the ice after all sensors."""
    if motion is None:
        return None
    behind = motion_rows(error, motion.n_unknowns)
    return motion.updated(behind @ estimate, error.covariance(behind))


_ONE_CLOCK = 0.35  # prior probability that the clocks agree
_AGREE_S = 2e-3  # error of clocks that agree
_DOUBTFUL = 0.01  # posterior probability that they agree above which a delay is not corrected
_BEYOND = 2.5  # standard deviations of the prior, beyond which errors of the odometry pass for a delay


def delay_moments(delay_s: float, delay_sigma_s: float, clock_sigma_s: float) -> tuple[float, float]:
    r"""Return the mean and the standard deviation of a delay under a mixture prior.

    Most recordings have one clock, and some have two. With the prior

    .. math:: p(τ) = 0.35 N(τ; 0, 2\ \mathrm{ms}) + 0.65 N(τ; 0, σ)

    and a likelihood of τ that is normal, the posterior is a mixture of two normal distributions. Where the
    clocks agree with a posterior probability of more than 0.01, the delay is not corrected: its mean is 0,
    and its standard deviation the root of the second moment. A delay beyond 2.5 σ is none: an odometry that
    contradicts the fixes passes for one, and the prior is left as it is.

    `delay_s`, `delay_sigma_s`: mean and standard deviation of the delay under the second part of the prior
    alone [s]. `clock_sigma_s`: its standard deviation σ [s]. Returns `mean_s, sigma_s`: mean and standard
    deviation of the delay [s].

    Where the records say nothing, the variance is 0.65 of that of the second part:

    >>> mean_s, sigma_s = delay_moments(0.0, 0.4, 0.4)
    >>> round(mean_s, 3), round(sigma_s, 3)
    (0.0, 0.322)

    A delay that is well determined stays as it is:

    >>> mean_s, sigma_s = delay_moments(0.5, 0.02, 0.4)
    >>> round(mean_s, 3), round(sigma_s, 3)
    (0.5, 0.02)
    """
    information = max(delay_sigma_s**-2.0 - clock_sigma_s**-2.0, 1e-9)
    likely_s = delay_s * delay_sigma_s**-2.0 / information
    priors = np.array([_AGREE_S, clock_sigma_s]) ** 2
    spread = priors + 1.0 / information
    log_weight = np.log([_ONE_CLOCK, 1.0 - _ONE_CLOCK]) - 0.5 * (np.log(spread) + likely_s**2 / spread)
    weight = np.exp(log_weight - log_weight.max())
    weight /= weight.sum()
    means, variances = likely_s * priors / spread, priors / information / spread
    if abs(likely_s) > _BEYOND * clock_sigma_s and information > clock_sigma_s**-2.0:
        return 0.0, float(np.sqrt((1.0 - _ONE_CLOCK) * clock_sigma_s**2))
    second_moment = float(weight @ (variances + means**2))
    mean_s = 0.0 if weight[0] > _DOUBTFUL else float(weight @ means)
    return mean_s, float(np.sqrt(second_moment - mean_s**2))


def place_landmarks(
    recording: OdometryRecording, path: SmoothedPath, config: LocalizationConfig
) -> SurfacePoints:
    """Place the landmarks that pass the gates, with the covariance of sighting and path.

    With R the attitude and o the offset in the body frame, the landmark is p + R o and
    its covariance R C Rᵀ + J P Jᵀ, J = [I, ∂(R o)/∂ψ, ∂(R o)/∂θ, ∂(R o)/∂φ]. The first
    part is independent; the second is shared with its neighbours through the keyframe of
    each point.

    The gates are those of the glacier paper; thinned by information, landmarks of any range
    pass, and those are selected that lower the variance of a map about the path the most.
    """
    sightings = recording.sightings
    ellipsoid_m = np.sqrt(np.linalg.eigvalsh(sightings.covariance)[:, -1])
    by_range = config.landmark_thinning == "range"
    least_range_m = config.landmark_min_range_m if by_range else 0.0
    keep = (ellipsoid_m <= config.landmark_max_sigma_m) & (sightings.range_m > least_range_m)
    if len(keep) == 0:
        raise InputError(
            "no landmark could be placed by the images, as where neighbours overlap too little; give more images of the same ground, or "
            "localize the file of fixes alone."
        )
    if not keep.any():
        raise InputError(
            f"none of {len(keep)} landmarks passes the gates (1σ ≤ {config.landmark_max_sigma_m} m, first seen beyond "
            f"{least_range_m} m); loosen localization.landmark_max_sigma_m or landmark_min_range_m (--set)."
        )
    pose = sightings.pose[keep]
    attitude = path.attitude_rad[pose]
    rotation = rotations(attitude)
    arm = np.einsum("nij,nj->ni", rotation, sightings.offset[keep])
    own = _symmetric(rotation @ sightings.covariance[keep] @ rotation.transpose(0, 2, 1))
    jacobian = pose_jacobian(arm, attitude)
    shared = jacobian @ path.covariance[pose] @ jacobian.transpose(0, 2, 1)
    points = SurfacePoints(
        path.position[pose] + arm,
        covariance=_symmetric(own + shared),
        origins=path.position[pose] + rotation @ recording.camera_in_body_m,
        body=path.position[pose],
        range_m=sightings.range_m[keep],
        crs=recording.crs,
        vertical_datum=recording.vertical_datum,
        own_covariance=own,
        keyframe=path.error.keyframe_at(recording.odometry.time_s[pose]),
        heading_rad=attitude[:, 2],
    )
    return points if by_range else _most_informative(points, path, config)


_CONTACT_M = 0.02  # height of the wheels over the ground that they stand on, 1 σ


def ground_of_path(recording: OdometryRecording, path: SmoothedPath) -> SurfacePoints:
    """Return the ground below the poses, whose errors are shared as those of the path are."""
    own = np.tile(_CONTACT_M**2 * np.eye(3), (len(path.position), 1, 1))
    return SurfacePoints(
        path.position,
        covariance=_symmetric(own + path.covariance[:, :3, :3]),
        origins=path.position + recording.camera_in_body_m,
        body=path.position,
        crs=recording.crs,
        vertical_datum=recording.vertical_datum,
        own_covariance=own,
        keyframe=path.error.keyframe_at(recording.odometry.time_s),
        heading_rad=path.attitude_rad[:, 2],
    )


def _most_informative(points: SurfacePoints, path: SmoothedPath, config: LocalizationConfig) -> SurfacePoints:
    """Select the landmarks that lower the variance of a map the most, in their order."""
    length_m = float(np.linalg.norm(np.diff(path.position, axis=0), axis=1).sum())
    east, north = path.position[:, 0], path.position[:, 1]
    bounds = (float(east.min()), float(north.min()), float(east.max()), float(north.max()))
    chosen = most_informative(
        points,
        max(round(config.landmarks_per_m * length_m), 1),
        bounds,
        variance_m2=config.terrain_variance_m2,
        length_scale_m=config.terrain_length_scale_m,
    )
    is_chosen = np.zeros(len(points), dtype=np.bool_)
    is_chosen[chosen] = True
    return points.select(is_chosen)


def _symmetric(matrices: FloatArray) -> FloatArray:
    symmetric: FloatArray = 0.5 * (matrices + matrices.transpose(0, 2, 1))
    return symmetric
