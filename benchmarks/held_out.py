"""Check by swaths left out, and certificates, held against the truth: ``python -m benchmarks.held_out``.

Surveys of the statistical fidelity on sites of 160 m with four swaths, terrain of 25 to 60 m of correlation, a
satellite's cells of 1 m. Every map is made as a mission makes it, kernel chosen. In the second group the
kernel is stated, Matérn 3/2 of 2.2 m and 0.1 m, so that landforms vanish between the landmarks; in the third the path
states a tenth of its error, which moves swaths slowly and looks like terrain: no swath left out shows it.

Sixteen drives in images (``examples/short_drive.toml``, 150 m, other seeds) are simulated and mapped too: one drive holds
a few independent errors only, and its share of points within their intervals depends on the type of processor. Rows of the
likeliest kernel alone show what the average over kernels, which the map is, changes in the predictions.

Drives are stored in the temporary folder for as long as the code that makes them stays the same, finished surveys for as
long as that of the reconstruction does. Seeds below 100 were used to choose settings; surveys are judged from 500 on,
drives from 600 on.
"""

import hashlib
import pickle
import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal, NamedTuple

import numpy as np

import planners
import survey
from benchmarks.image_surveys import EXAMPLES, _simulated
from benchmarks.report import Row, cpu_seconds, main
from benchmarks.stored_parts import code_digest
from sim.config.mission import MissionConfig
from sim.simulate.simulation import simulate_statistical
from sim.world.site import World, build_world
from survey.core.arrays import FloatArray
from survey.data.path_error import PathError
from survey.data.recording import Recording
from survey.data.truth import Truth
from survey.reconstruction import GaussianProcessConfig
from survey.reconstruction.checks import HeldOut, PredictiveCheck, PredictiveScores
from survey.reconstruction.joint.joint_map import JointTerrain
from survey.reconstruction.joint.solution import check_by_swaths, checked_map, held_out_swaths
from survey.reconstruction.terrain_map import Reconstruction
from survey.scoring import certificate
from vision_slam import LocalizationConfig, localize
from vision_slam.drive_estimate import Localization
from vision_slam.odometry.onboard import read_visual_odometry

STORED = Path(tempfile.gettempdir()) / "firnline-held-out"
_FIRST_SEED, _FIRST_DRIVE = 500, 600
_GRID_STEP_M = 4.0
_FAR_M = 5.0
_UNDERSTATED = 1.0 / 100.0
_NO_LANDFORMS = GaussianProcessConfig(
    fit=False, calibrate=True, family="matern-3/2", variance_m2=0.01, length_scale_m=2.2, mean="plane"
)
_DRIVE_CODE = ("sim", "vision_slam", "planners", "survey/core", "survey/data", "survey/terrain")
Group = Literal["honest", "kernel", "path"]


@dataclass(frozen=True)
class Outcome:
    """One survey: error, claim and coverage of its map, what the check found, and the CPU time of map and check [s]."""

    rmse_m: float
    relative_m: float
    upper_m: float
    relative_upper_m: float
    n_false: int
    n_certified: int
    coverage_before: float
    coverage_after: float
    pit_tenths: tuple[float, ...]
    contradicts: bool
    map_s: float
    check_s: float


class Drive(NamedTuple):
    """A drive in images: its path and landmarks, the ground, the satellite's cells, and the nodes of its map."""

    found: Localization
    truth: survey.Dem
    prior: survey.Dem
    grid: survey.Grid


class LeftOut(NamedTuple):
    """A map in images: scores of points left out beyond 5 m, what the check found, coverage and error of the map."""

    far: PredictiveScores
    far_of_one_kernel: PredictiveScores
    contradicts: bool
    coverage: float
    rmse_m: float


def measure(quick: bool) -> Iterator[Row]:
    """Yield the rows."""
    n_honest, n_wrong, n_drives = (2, 1, 1) if quick else (30, 5, 16)
    yield from _honest_rows(_surveys("honest", n_honest))
    yield from _wrong_rows("kernels without landforms", _surveys("kernel", n_wrong), 0.9)
    yield from _wrong_rows("paths that state a tenth of their error", _surveys("path", n_wrong), None)
    yield from _image_rows(n_drives)


def _surveys(group: Group, n: int) -> list[Outcome]:
    return [_survey(seed, group) for seed in range(_FIRST_SEED, _FIRST_SEED + n)]


def _honest_rows(done: Sequence[Outcome]) -> Iterator[Row]:
    alarms = float(np.mean([one.contradicts for one in done]))
    yield Row.of("honest surveys: contradicted by swaths left out", alarms, "1", "<=", 0.05)
    covered = float(np.mean([one.coverage_after for one in done]))
    yield Row("honest surveys: coverage of 95 %, mean", covered, "1", "0.93 to 0.97", 0.93 <= covered <= 0.97)
    yield Row("honest surveys: coverage of 95 %, worst", min(one.coverage_after for one in done), "1")
    tenths = np.mean([one.pit_tenths for one in done], axis=0)
    yield Row.of("honest surveys: PIT tenths, least", float(tenths.min()), "1", ">=", 0.08)
    yield Row.of("honest surveys: PIT tenths, most", float(tenths.max()), "1", "<=", 0.12)
    within = float(np.mean([one.rmse_m <= one.upper_m for one in done]))
    yield Row.of("honest surveys: RMSE below its 95 % limit", within, "1", ">=", 0.9)
    within = float(np.mean([one.relative_m <= one.relative_upper_m for one in done]))
    yield Row.of("honest surveys: RMSE without the offset below its 95 % limit", within, "1", ">=", 0.9)
    n_certified, n_false = sum(one.n_certified for one in done), sum(one.n_false for one in done)
    yield Row("honest surveys: classes certified", float(n_certified), "1")
    yield Row.of("honest surveys: certified and false", n_false / max(n_certified, 1), "1", "<=", 0.05)
    cost = sum(one.check_s for one in done) / sum(one.map_s for one in done)
    yield Row.of("check by swaths left out, CPU time over that of the map without it", cost, "1", "<=", 0.3)


def _wrong_rows(name: str, done: Sequence[Outcome], bar: float | None) -> Iterator[Row]:
    caught = float(np.mean([one.contradicts for one in done]))
    shown = f"{name}: contradicted by swaths left out"
    yield Row(shown, caught, "1") if bar is None else Row.of(shown, caught, "1", ">=", bar)
    before = float(np.mean([one.coverage_before for one in done]))
    after = float(np.mean([one.coverage_after for one in done]))
    yield Row(f"{name}: coverage of 95 % before widening", before, "1")
    yield Row(f"{name}: coverage of 95 % after widening", after, "1")
    n_certified, n_false = sum(one.n_certified for one in done), sum(one.n_false for one in done)
    yield Row(f"{name}: classes certified", float(n_certified), "1")
    shown = f"{name}: certified and false"
    share = n_false / max(n_certified, 1)
    yield Row(shown, share, "1") if bar is None else Row.of(shown, share, "1", "<=", 0.05)


def _image_rows(n: int) -> Iterator[Row]:
    """Leave swaths of drives in images out, with the satellite and without."""
    drives = [_drive(seed) for seed in range(_FIRST_DRIVE, _FIRST_DRIVE + n)]
    for name, with_prior in (("images, with a satellite", True), ("images, without a satellite", False)):
        done = [_left_out(drive, with_prior=with_prior) for drive in drives]
        within = [one.far.coverage_95 for one in done]
        shown = f"{name}: swaths left out, beyond 5 m, within 95 %"
        yield Row.of(f"{shown}, mean", float(np.mean(within)), "1", ">=", 0.92)
        yield Row(f"{shown}, worst", min(within), "1")
        alone = float(np.mean([one.far_of_one_kernel.coverage_95 for one in done]))
        yield Row(f"{shown}, mean, by the likeliest kernel alone", alone, "1")
        z_rms = float(np.sqrt(np.mean([one.far.z_rms**2 for one in done])))
        yield Row(f"{name}: swaths left out, beyond 5 m, root mean square of z", z_rms, "1")
        alarms = float(np.mean([one.contradicts for one in done]))
        yield Row(f"{name}: contradicted by swaths left out", alarms, "1")
        covered = [one.coverage for one in done]
        yield Row.of(f"{name}: coverage of the map, mean", float(np.mean(covered)), "1", ">=", 0.92)
        yield Row(f"{name}: coverage of the map, worst", min(covered), "1")
        yield Row(f"{name}: RMSE of the map, median", float(np.median([one.rmse_m for one in done])), "m")


def _drive(seed: int) -> Drive:
    """Return a drive in images, simulated where the code has not done so before."""
    place = STORED / code_digest(_DRIVE_CODE) / f"drive-{seed}"
    run = _simulated(EXAMPLES / "short_drive.toml", place, (f"seed={seed}",))
    recording = Recording.read(run / "2-simulate" / "recording")
    visual = read_visual_odometry(run / "2-simulate" / "recording" / "onboard")
    found = localize(replace(recording, frames=None, camera=None), LocalizationConfig(), visual=visual)
    prior = survey.Dem.read(run / "1-plan" / "prior.tif")
    grid = survey.Grid.over(survey.SurveyArea.read(run / "1-plan" / "area.gpkg").bounds, 1.0, prior.crs)
    return Drive(found, Truth.read(run / "2-simulate" / "truth").dem, prior, grid)


def _left_out(drive: Drive, *, with_prior: bool) -> LeftOut:
    """Map a drive with its satellite or without, and predict the swaths that are left out."""
    assert drive.found.trajectory.error is not None
    model = JointTerrain(drive.found.trajectory.error, drive.prior if with_prior else None)
    solution = model.solve(drive.found.points, drive.grid.bounds)
    held_out, alone = (held_out_swaths(one) for one in (solution, replace(solution, average=None)))
    assert held_out is not None
    assert alone is not None
    mapped = model.map(drive.found.points, drive.grid).reconstruction
    error = _errors(mapped, drive.truth)
    check, rmse_m = PredictiveCheck.of(held_out), float(np.sqrt(np.mean(error**2)))
    assert check is not None
    scores = _far_scores(held_out), _far_scores(alone)
    return LeftOut(*scores, check.contradicts, _coverage(error, mapped), rmse_m)


def _far_scores(held_out: HeldOut) -> PredictiveScores:
    far = held_out.distance_m > _FAR_M
    return PredictiveScores.of(held_out.error_m[far], held_out.sigma_m[far])


def _survey(seed: int, group: Group) -> Outcome:
    """Return the outcome of a survey, from the store where the code is the same."""
    file = STORED / _code() / f"{group}-{seed}.pickle"
    if not file.exists():
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_bytes(pickle.dumps(_surveyed(seed, group)))
    outcome: Outcome = pickle.loads(file.read_bytes())
    return outcome


def _surveyed(seed: int, group: Group) -> Outcome:
    config = _mission(seed)
    world = build_world(config)
    route = planners.plan(world.area, world.prior, config.planner, rover=config.rover, fleet=config.fleet)
    recording, _ = simulate_statistical(world.terrain, route, config)
    found = localize(recording, config.assumed)
    assert found.trajectory.error is not None
    points, path = found.points, found.trajectory.error
    if group == "path":
        path = PathError(path.time_s, path.information / _UNDERSTATED, path.n_states)
    grid = survey.Grid.over(world.area.bounds, _GRID_STEP_M, world.area.crs)
    model = JointTerrain(path, world.prior, _NO_LANDFORMS if group == "kernel" else GaussianProcessConfig())
    solution, map_s = cpu_seconds(lambda: model.solve(points, grid.bounds))
    plain = solution.on(grid).reconstruction
    check = check_by_swaths(solution)
    assert check is not None
    # A map that is averaged over kernels predicts the swaths with each of them as it is solved.
    _, once_s = cpu_seconds(lambda: held_out_swaths(replace(solution, average=None)))
    check_s = once_s * (len(solution.average.others) if solution.average else 1)
    map_s -= check_s if solution.average else 0.0
    result = checked_map(solution, grid, None, is_tested=True).reconstruction
    return _judged(world, result, plain, check, (map_s, check_s))


def _judged(
    world: World,
    result: Reconstruction,
    plain: Reconstruction,
    check: PredictiveCheck,
    times_s: tuple[float, float],
) -> Outcome:
    error, certified = _errors(result, world.terrain), certificate(result)
    assert certified is not None
    rmse, relative = float(np.sqrt(np.mean(error**2))), float(error.std())
    scores = PredictiveScores.of(error.ravel(), result.std.elevation.ravel())
    claims = [(rmse, verdict) for verdict in certified.absolute if verdict.met]
    claims += [(relative, verdict) for verdict in certified.relative if verdict.met]
    return Outcome(
        rmse,
        relative,
        certified.claim.absolute.upper_m,
        certified.claim.relative.upper_m,
        sum(value > verdict.limit_m for value, verdict in claims),
        len(claims),
        _coverage(error, plain),
        scores.coverage_95,
        scores.pit_tenths,
        check.contradicts,
        *times_s,
    )


def _mission(seed: int) -> MissionConfig:
    rng = np.random.default_rng(seed)
    return MissionConfig.model_validate(
        {
            "schema_version": 1,
            "name": "held-out",
            "seed": seed,
            "terrain": {
                "source": "random",
                "size_m": 180.0,
                "relief_m": float(rng.uniform(6.0, 14.0)),
                "length_scale_m": float(rng.uniform(25.0, 60.0)),
            },
            "area": {"bounds_m": (526010.0, 6478010.0, 526170.0, 6478170.0)},
            "planner": {"pattern": "lawnmower", "swaths": 4},
        }
    )


def _errors(result: Reconstruction, truth: survey.Dem) -> FloatArray:
    error: FloatArray = result.mean.elevation - truth.at(result.mean.xy).reshape(result.mean.shape)
    return error


def _coverage(error: FloatArray, result: Reconstruction) -> float:
    return float(np.mean(np.abs(error) <= 1.959964 * result.std.elevation))


def _code() -> str:
    folder = Path(survey.__file__).parent / "reconstruction"
    code = b"".join(path.read_bytes() for path in sorted(folder.rglob("*.py")))
    return hashlib.sha256(code + Path(__file__).read_bytes()).hexdigest()[:12]


if __name__ == "__main__":
    main("Held-out swaths", measure)
