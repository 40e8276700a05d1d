"""The rover's physics and its instruments: speed, patch changes, slip, energy, noise against its models.

The rows of the physics are repeated for each rigid-body engine that is installed: Bullet and MuJoCo.
"""

from collections.abc import Iterator
from importlib.util import find_spec
from typing import Any

import numpy as np
from scipy.signal import welch

from benchmarks.report import Row, cpu_seconds, main
from benchmarks.small_inputs import BARE_SCENERY
from planners import Rover
from sim.config.rover import PhysicsConfig
from sim.config.sensors import GpsConfig, InertialConfig, InstrumentsConfig
from sim.config.world import SceneryConfig
from sim.instruments.dead_reckoning import InertialUnit
from sim.instruments.gps import GPS_PROFILES, GpsReceiver
from sim.vehicle.motion import RoverMotion
from sim.vehicle.pursuit import PurePursuit
from sim.vehicle.rover import ContactRover
from sim.world.fine_terrain import FineTerrain, fine_terrain
from survey.core.arrays import FloatArray
from survey.core.streams import stream
from survey.data.dem import Dem
from survey.data.grid import Grid
from survey.terrain import random_dem
from tests.sim.vehicle.energy_balance import EnergyBalance

ROVER = Rover(mass_kg=18.0, idle_w=20.0)
ENGINES = {
    engine: name
    for engine, (module, name) in {"bullet": ("pybullet", "Bullet"), "mujoco": ("mujoco", "MuJoCo")}.items()
    if find_spec(module) is not None
}
SMOOTH = SceneryConfig(**BARE_SCENERY)


def rows(quick: bool) -> Iterator[Row]:
    """Yield one row per claim."""
    for engine in ENGINES:
        yield from _drive_rows(engine, 100.0 if quick else 600.0)
        yield from _slip_rows(engine)
        yield from _turn_rows(engine)
        yield from _energy_rows(engine, 5.0 if quick else 20.0)
    n = 100_000 if quick else 200_000
    for name in GPS_PROFILES:
        yield from _gps_rows(name, n)
    yield from _allan_rows(n)


def hills(size_m: float, seed: int) -> FineTerrain:
    """Return rolling ground with dunes, sastrugi and hummocks."""
    grid = Grid((0.0, 0.0, size_m, size_m), 1.0, "EPSG:32608")
    dem = random_dem(
        "squared-exponential", grid, stream(seed, "benchmark"), relief_m=4.0, length_scale_m=60.0
    )
    # Rougher snow has places too steep for friction 0.5, where the rover stalls as it should.
    config = SceneryConfig(
        dune_sd_m=0.07, sastrugi_sd_m=0.02, hummock_sd_m=0.03, crevasses_per_ha=0.0, dirt_cones_per_ha=0.0
    )
    return fine_terrain(dem, config, seed)


def slope(deg: float, size_m: float = 80.0) -> FineTerrain:
    """Return a plane that rises to the east."""
    grid = Grid((0.0, 0.0, size_m, size_m), 1.0, "EPSG:32608")
    east = np.tile(np.arange(size_m + 1.0), (round(size_m) + 1, 1))
    return fine_terrain(Dem.on(grid, np.tan(np.radians(deg)) * east), SMOOTH, 1)


def _physics(engine: str, **settings: Any) -> PhysicsConfig:
    return PhysicsConfig(engine=engine, **settings)  # type: ignore[arg-type]  # one of ENGINES


def _drive_rows(engine: str, length_m: float) -> Iterator[Row]:
    """Drive there and back on rolling ground, at 240 Hz, over many patches."""
    lines = np.arange(int(np.ceil(length_m / 110.0)))
    turns = [(20.0 if (k + end) % 2 == 0 else 120.0, 30.0 + 10.0 * k) for k in lines for end in (0, 1)]
    pursuit = PurePursuit(np.array(turns), 1.0, PhysicsConfig())
    rover = ContactRover(hills(140.0, 5), _physics(engine), ROVER, np.array(turns[0]), 0.0)
    (places, changes), seconds = cpu_seconds(lambda: _followed(rover, pursuit))
    driven_s = len(places) * rover.dt_s
    yield Row.of(f"{ENGINES[engine]}: simulated over CPU time", driven_s / seconds, "", ">=", 20.0)
    # A route is done within the goal radius of its end.
    yield Row.of(
        f"{ENGINES[engine]}: drive", pursuit.progress_m, "m", ">=", length_m - PhysicsConfig().goal_radius_m
    )
    jumps = np.linalg.norm(np.diff(places, 2, axis=0), axis=1)
    at_changes = [jumps[max(k - 2, 0) : k + 3].max() for k in changes]
    yield Row(f"{ENGINES[engine]}: patch changes", len(changes), "")
    yield Row.of(f"{ENGINES[engine]}: largest jump at a change", 1e3 * max(at_changes), "mm", "<=", 1.0)
    yield Row(f"{ENGINES[engine]}: largest jump anywhere", 1e3 * float(jumps.max()), "mm")


def _followed(rover: ContactRover, pursuit: PurePursuit) -> tuple[FloatArray, list[int]]:
    """Drive to the end of a route; the place at every step, and the steps after which the patch changed."""
    places, changes, patch = [], [], rover.patch_centre
    left = right = 0.0
    state = rover.state
    longest = 3.0 * pursuit.length_m / rover.dt_s  # a rover that is stuck drives for ever
    while not pursuit.is_done(np.array(state.position[:2])) and len(places) < longest:
        if len(places) % 12 == 0:
            x, y, z, w = state.quaternion
            heading = float(np.arctan2(2.0 * (x * y + w * z), 1.0 - 2.0 * (y * y + z * z)))
            left, right = pursuit.track_speeds(np.array(state.position[:2]), heading)
        rover.step(left, right)
        state = rover.state
        places.append(state.position)
        if rover.patch_centre != patch:
            patch = rover.patch_centre
            changes.append(len(places))
    return np.array(places), changes


def uphill_slip(engine: str, deg: float, friction: float) -> float:
    """Share of what the tracks unroll that is not driven, straight up a slope at 1 m/s, after 2 s."""
    rover = ContactRover(
        slope(deg), _physics(engine, friction=friction), ROVER, np.array([20.0, 40.0]), heading_rad=0.0
    )
    for _ in range(480):
        rover.step(1.0, 1.0)
    first = rover.state
    for _ in range(1200):
        rover.step(1.0, 1.0)
    last = rover.state
    driven = np.linalg.norm(np.subtract(last.position, first.position)) * np.sign(
        last.position[0] - first.position[0]
    )
    return float(1.0 - driven / np.mean(np.subtract(last.rolled_m, first.rolled_m)))


def _slip_rows(engine: str) -> Iterator[Row]:
    name = ENGINES[engine]
    degrees = (0.0, 5.0, 10.0, 15.0, 18.0)
    slips = [uphill_slip(engine, deg, 0.5) for deg in degrees]
    for deg, slip in zip(degrees, slips, strict=True):
        yield Row(f"{name}: slip on snow (friction 0.5), {deg:g}° up", 100.0 * slip, "%")
    yield Row.of(
        f"{name}: least rise of slip from slope to slope", 100.0 * float(np.diff(slips).min()), "%", ">=", 0.0
    )
    yield Row.of(
        f"{name}: slip on ice (friction 0.15), 5° up: stalls",
        100.0 * uphill_slip(engine, 5.0, 0.15),
        "%",
        ">=",
        90.0,
    )


def turned(engine: str, left: float, right: float, heading_rad: float, seconds: float = 6.0) -> float:
    """Turn about the vertical over a time on level ground [rad]."""
    rover = ContactRover(slope(0.0), _physics(engine), ROVER, np.array([40.0, 40.0]), heading_rad)
    turn = 0.0
    for _ in range(round(seconds / rover.dt_s)):
        rover.step(left, right)
        turn += rover.state.rate[2] * rover.dt_s
    return turn


def _turn_rows(engine: str) -> Iterator[Row]:
    gauge, seconds = PhysicsConfig().track_gauge_m, 6.0
    for left, right in ((0.7, 1.0), (-0.3, 0.3)):
        kinematic = (right - left) / gauge * seconds
        turns = [turned(engine, left, right, heading, seconds) for heading in (0.0, 0.5, 0.25 * np.pi)]
        name = f"{ENGINES[engine]}: tracks {left:g}, {right:g} m/s: turn over the kinematic one"
        yield Row.of(name, float(np.mean(turns)) / kinematic, "", "<=", 0.9)
        yield Row(f"{name}, spread over three headings", float(np.ptp(turns)) / kinematic, "")


def _energy_rows(engine: str, seconds: float) -> Iterator[Row]:
    cases: dict[str, tuple[FineTerrain, float, float]] = {
        "level": (slope(0.0), 1.0, 1.0),
        "10° up": (slope(10.0, 100.0), 0.8, 0.8),
        "rolling ground": (hills(140.0, 5), 0.9, 1.0),
        "on the spot": (slope(0.0), -0.4, 0.4),
    }
    for name, (ground, left, right) in cases.items():
        x = 20.0 if name == "10° up" else 0.5 * (ground.bounds[0] + ground.bounds[2])
        rover = ContactRover(ground, _physics(engine), ROVER, np.array([x, 40.0]), 0.3)
        balance = EnergyBalance(rover)
        for _ in range(round(seconds / rover.dt_s)):
            balance.step(left, right)
        share = abs(balance.missing_j) / balance.motors_j
        yield Row.of(f"{ENGINES[engine]}: energy not accounted for, {name}", 100.0 * share, "%", "<=", 2.0)


def standing(seconds: float) -> RoverMotion:
    """Return the motion of a rover that stands still."""
    n = 2
    zero = np.zeros((n, 3))
    turn = np.tile([0.0, 0.0, 0.0, 1.0], (n, 1))
    return RoverMotion(np.array([0.0, seconds]), zero, turn, zero, zero, np.zeros((n, 2)))


def gps_errors(profile: str, n: int, seed: int = 1) -> FloatArray:
    """Errors of n fixes (n, 3) a second apart [m], the vertical brought to the horizontal scale."""
    config = InstrumentsConfig(gps=GpsConfig(profile=profile))  # type: ignore[arg-type]  # one of GPS_PROFILES
    fixes = GpsReceiver(config, 0.0, seed).sense(standing(float(n - 1)))
    assert fixes is not None
    return fixes.position / [1.0, 1.0, config.gps.vertical_factor]


def _gps_rows(name: str, n: int) -> Iterator[Row]:
    """Compare autocovariance and spectrum with the model; the bars are four standard errors of the estimates."""
    profile, errors = GPS_PROFILES[name], gps_errors(name, n)
    variance = profile.bias_sigma_m**2 + profile.white_sigma_m**2
    lags = [0, 1, round(0.5 * profile.correlation_s), round(profile.correlation_s)]
    worst = 0.0
    for lag in lags:
        found = float(np.mean(errors[: n - lag] * errors[lag:]))
        model = profile.bias_sigma_m**2 * np.exp(-lag / profile.correlation_s)
        model += profile.white_sigma_m**2 * (lag == 0)
        worst = max(worst, abs(found - model) / variance)
    # The bias has about n / τ independent values on each of three axes.
    memory_s = profile.correlation_s if profile.bias_sigma_m else 1.0
    yield Row.of(
        f"GPS {name}: autocovariance off the model",
        worst,
        "of the variance",
        "<=",
        4.0 * np.sqrt(2.0 * memory_s / (3 * n)),
    )
    yield Row.of(f"GPS {name}: spectrum off the model", _spectrum_gap_db(errors, name), "dB", "<=", 1.0)


def _spectrum_gap_db(errors: FloatArray, name: str) -> float:
    """Largest gap between measured and modelled power in eight bands of frequency [dB]."""
    profile = GPS_PROFILES[name]
    frequency, power = welch(errors, fs=1.0, nperseg=4096, axis=0)
    frequency, power = frequency[2:-1], power[2:-1].mean(axis=1)
    a = np.exp(-1.0 / profile.correlation_s)
    shape = (1.0 - a * a) / (1.0 + a * a - 2.0 * a * np.cos(2.0 * np.pi * frequency))
    model = 2.0 * (profile.bias_sigma_m**2 * shape + profile.white_sigma_m**2)
    bands = np.array_split(np.arange(len(frequency)), np.geomspace(4, len(frequency), 8).astype(int)[:-1])
    gaps = [10.0 * np.log10(power[band].mean() / model[band].mean()) for band in bands]
    return float(np.abs(gaps).max())


def allan_deviation(rate: FloatArray, dt_s: float, tau_s: float) -> float:
    """Overlapping Allan deviation of a rate (N, axes) over an averaging time, root mean square over axes."""
    m = round(tau_s / dt_s)
    angle = np.vstack([np.zeros((1, rate.shape[1])), np.cumsum(rate, axis=0) * dt_s])
    second = angle[2 * m :] - 2.0 * angle[m:-m] + angle[: -2 * m]
    return float(np.sqrt(np.mean(second**2) / (2.0 * (m * dt_s) ** 2)))


def inertial_noise(n: int, seed: int = 1) -> tuple[InertialConfig, FloatArray, FloatArray]:
    """Return readings (n, 3 each) of a gyro and an accelerometer that stand still."""
    config = InertialConfig(rate_hz=20.0, gyro_bias_walk_deg_h_sqrt_h=120.0, force_bias_walk_m_s2_sqrt_h=0.3)
    read = InertialUnit(config, seed).sense(standing(n / config.rate_hz))
    assert read is not None
    return config, read.gyro_rad_s, read.specific_force_m_s2 - [0.0, 0.0, 9.81]


def _allan_rows(n: int) -> Iterator[Row]:
    config, gyro, force = inertial_noise(n)
    hour = 3600.0
    models: dict[str, tuple[FloatArray, float, float]] = {
        "gyro": (
            gyro,
            np.radians(config.gyro_noise_deg_sqrt_h) / hour**0.5,
            np.radians(config.gyro_bias_walk_deg_h_sqrt_h) / hour**1.5,
        ),
        "accelerometer": (
            force,
            config.force_noise_m_s2_sqrt_hz,
            config.force_bias_walk_m_s2_sqrt_h / hour**0.5,
        ),
    }
    length_s = n / config.rate_hz
    for name, (read, density, walk) in models.items():
        for tau in (0.1, 1.0, 10.0, 100.0):
            model = np.sqrt(density**2 / tau + walk**2 * tau / 3.0)
            gap = allan_deviation(read, 1.0 / config.rate_hz, tau) / model - 1.0
            # Of 3 axes over T there are about 3 T / τ independent averages; four standard errors.
            limit = max(400.0 / np.sqrt(2.0 * 3.0 * length_s / tau), 1.0)
            yield Row.of(
                f"Allan deviation of the {name} over {tau:g} s, off the model",
                100.0 * abs(gap),
                "%",
                "<=",
                limit,
            )


if __name__ == "__main__":
    main("Simulator physics", rows, packages=("numpy", "scipy", "pybullet", "mujoco"))
