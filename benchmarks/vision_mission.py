"""The survey of the glacier paper as one system: driven by its own estimate, mapped by its camera, judged.

Run with ``python -m benchmarks.vision_mission``. The missions are those of ``examples/mendenhall_like.toml``, by four
lawnmower swaths and by two piecewise-continuous ones, with seeds that no setting was chosen on (``FIRNLINE_MISSION_SEEDS``
names others, or fewer: ``71,72``). Each is run once, with two processes, and stored in the system's folder for temporary
files; whole runs that stand there are read. Along every driven path receivers are simulated again: 3 m without memory, and 3 m
that last a minute, assumed to last five. No error is debiased, and no place is recognised by hand.

``independent`` is the paper's treatment, around the satellite's elevations; ``landmarks on the real path`` is what that
treatment makes of a path without error, and no floor of the joint estimate. Folders that stand may have been driven by
an earlier version: they are named by their seed alone.
"""

import json
import os
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import nullcontext, suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import shapely

from benchmarks.image_surveys import (
    Outcome,
    Profile,
    Survey,
    fixes_along,
    judged,
    on_the_real_path,
    rows_of,
    survey_at,
)
from benchmarks.report import Row, main
from benchmarks.stored_parts import simulated_folder
from survey.core.arrays import FloatArray
from survey.core.documents import read_json
from survey.core.errors import CapacityError
from survey.data.recording import Recording
from survey.data.route import Route
from survey.data.sensors.records import GpsFixes
from survey.data.surface_points import SurfacePoints
from survey.reconstruction import Reconstruction, reconstruct
from survey.reconstruction.joint.joint_map import JointTerrain
from vision_slam import LocalizationConfig, localize
from vision_slam.odometry.odometer import VisualOdometry
from vision_slam.odometry.onboard import read_visual_odometry

EXAMPLES = Path(__file__).parents[1] / "examples"
MISSIONS = simulated_folder("missions")
SEEDS = tuple(int(seed) for seed in os.environ.get("FIRNLINE_MISSION_SEEDS", "71,72,73,74,75").split(","))
PLANNERS = {
    "lawnmower": (),
    "piecewise-continuous": ("planner.pattern=piecewise-continuous", "planner.swaths=2"),
}
WHITE = LocalizationConfig(gps_bias_sigma_m=0.1, gps_white_sigma_m=3.0)
LASTING = LocalizationConfig(gps_bias_sigma_m=3.0, gps_white_sigma_m=1.0, gps_correlation_time_s=300.0)
RECEIVERS: dict[str, tuple[Profile, LocalizationConfig]] = {
    "white GPS": ("white", WHITE),
    "GPS of 60 s": ("gauss-markov-60", LASTING),
}
CLASS_3_M, PAPER_M = 0.4572, {"lawnmower": 0.2827, "piecewise-continuous": 0.3323}
_SHORT = ("area.bounds_m=[526025.0,6478040.0,526055.0,6478060.0]",)
_LANDMARKS, _FAR_LANDMARKS = 50_000, 5_000
_MEMORY_MB = 2000.0


@dataclass(frozen=True)
class Mission(Survey):
    """A survey as a mission's folder holds it, and what it took."""

    folder: Path
    cost: dict[str, float]


def measure(quick: bool) -> Iterator[Row]:
    """Yield the rows."""
    for planner in list(PLANNERS)[: 1 if quick else None]:
        surveys = [survey_of(planner, seed, quick=quick) for seed in (SEEDS[:1] if quick else SEEDS)]
        yield from _driven(planner, surveys, quick=quick)
        yield from _mapped(planner, surveys)


def _driven(planner: str, surveys: list[Mission], *, quick: bool) -> Iterator[Row]:
    """Yield how the drives went, what they saw, and what they took."""
    drives = [read_json(survey.folder / "2-simulate" / "drive.json", "the drive") for survey in surveys]
    yield Row.of(
        f"{planner}: drives that arrived",
        float(np.mean([drive["ending"] == "arrived" for drive in drives])),
        "1",
        ">=",
        1.0,
    )
    off = [float(np.percentile(_deviation(survey), 95.0)) for survey in surveys]
    yield Row(f"{planner}: 95 % of the way within, of the plan, worst drive", max(off), "m")
    counts = np.array([_landmarks(survey.found) for survey in surveys])
    for name, kept, bar in (
        ("landmarks kept", counts[:, 0], _LANDMARKS),
        ("first seen beyond 5 m", counts[:, 1], _FAR_LANDMARKS),
    ):
        label, least = f"{planner}: {name}, fewest", float(kept.min())
        is_barred = planner == "lawnmower" and not quick
        yield Row.of(label, least, "1", ">=", bar) if is_barred else Row(label, least, "1")
    paces = [
        drive["duration_s"] / survey.cost["wall_s"] for drive, survey in zip(drives, surveys, strict=True)
    ]
    loads = [survey.cost["load"] for survey in surveys]
    # A machine that does other work at the same time says nothing of the time that a mission takes.
    pace, load = paces[int(np.argmin(loads))], min(loads)
    yield Row.of(f"{planner}: duration / wall time of the mission with the least load", pace, "x", ">=", 4.0)
    yield Row(f"{planner}: load of the machine meanwhile", load, "1")
    yield Row(f"{planner}: duration / wall time of the mission, slowest", min(paces), "x")
    yield Row(f"{planner}: load of the machine meanwhile, most", max(loads), "1")
    busy = [drive["duration_s"] / survey.cost["cpu_s"] for drive, survey in zip(drives, surveys, strict=True)]
    yield Row(f"{planner}: duration / CPU time of both processes, slowest", min(busy), "x")
    peak = max(survey.cost["peak_mb"] for survey in surveys)
    yield Row.of(f"{planner}: peak memory of both processes", peak, "MB", "<=", _MEMORY_MB)
    growth = max(survey.cost["growth_mb"] for survey in surveys)
    yield Row(f"{planner}: growth of it over the last three quarters of a mission", growth, "MB")


def _mapped(planner: str, surveys: list[Mission]) -> Iterator[Row]:
    """Yield what the maps are worth, each treatment beside the others."""
    known = [_around_the_prior(on_the_real_path(survey, LASTING), survey) for survey in surveys]
    floor = [
        judged(found, survey.real, survey.real.trajectory)
        for found, survey in zip(known, surveys, strict=True)
    ]
    yield from rows_of(f"{planner}, landmarks on the real path", floor)
    for name, (profile, assumed) in RECEIVERS.items():
        maps: dict[str, list[Outcome]] = {"joint": [], "joint, 4 stakes": [], "independent": []}
        for draw, survey in enumerate(surveys):
            fixes = fixes_along(survey, profile, 2000 + draw)
            for treatment, done in maps.items():
                # Landmarks that claim to be independent, on swaths that contradict each other, may have no map that settles.
                with suppress(CapacityError) if treatment == "independent" else nullcontext():
                    done.append(treated(survey, fixes, assumed, treatment))
        for treatment, done in maps.items():
            yield Row(f"{planner}, {treatment}, {name}: surveys that it maps", float(len(done)), "1")
            if done:
                yield from rows_of(f"{planner}, {treatment}, {name}", done)
                yield from _bars(planner, treatment, name, done)


def _bars(planner: str, treatment: str, receiver: str, done: list[Outcome]) -> Iterator[Row]:
    name = f"{planner}, {treatment}, {receiver}"
    rmse = np.array([out.rmse_m for out in done])
    if treatment == "joint":
        yield Row.of(f"{name}: share in Class 3", float(np.mean(rmse <= CLASS_3_M)), "1", ">=", 1.0)
        coverage = float(np.mean([out.coverage for out in done]))
        holds = 0.92 <= coverage <= 0.98
        yield Row(f"{name}: coverage, held to", coverage, "1", "0.92 to 0.98", holds)
        bar = PAPER_M[planner] if receiver == "white GPS" else 0.30 if planner == "lawnmower" else None
        if bar is not None:
            yield Row.of(f"{name}: median, held to", float(np.median(rmse)), "m", "<=", bar)
    elif treatment == "joint, 4 stakes":
        yield Row.of(f"{name}: share within 0.28 m", float(np.mean(rmse <= 0.28)), "1", ">=", 0.9)


def survey_of(planner: str, seed: int, *, quick: bool) -> Mission:
    """Return a mission of the benchmark; it is driven where that was not done before."""
    example = EXAMPLES / ("short_drive.toml" if quick else "mendenhall_like.toml")
    chosen = (f"seed={seed}", *PLANNERS[planner], *(_SHORT if quick else ()))
    runs = MISSIONS / (f"short-{seed}" if quick else f"{planner}-{seed}")
    folder, cost = run_once(example, runs, chosen)
    recording = Recording.read(folder / "2-simulate" / "recording")
    survey = survey_at(
        folder, recording, read_visual_odometry(folder / "2-simulate" / "recording" / "onboard")
    )
    return Mission(**vars(survey), folder=folder, cost=cost)


def run_once(mission: Path, runs: Path, settings: Sequence[str]) -> tuple[Path, dict[str, float]]:
    """Run a mission with two processes unless it has been run; return its folder and what it took."""
    kept = runs / "cost.json"
    if not kept.exists():
        words = [word for text in settings for word in ("--set", text)]
        command = [
            sys.executable,
            "-m",
            "firnline.cli.main",
            "run",
            str(mission),
            "--runs",
            str(runs),
            "--fresh",
        ]
        began = time.monotonic()
        with subprocess.Popen(
            [*command, "--workers", "2", "-q", *words], stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL
        ) as process:
            memory = list(_memory_mb(process))
            _, status, usage = os.wait4(process.pid, 0)
            process.returncode = os.waitstatus_to_exitcode(status)
        if process.returncode:
            raise RuntimeError(
                f"{mission.name} in {runs} ended with code {process.returncode}; see its words above."
            )
        wall_s, quarter = time.monotonic() - began, max(memory[: len(memory) // 4 + 1])
        cost = {
            "wall_s": wall_s,
            "cpu_s": usage.ru_utime + usage.ru_stime,
            "peak_mb": max(memory),
            "growth_mb": max(memory) - quarter,
            "load": os.getloadavg()[2],
        }
        kept.write_text(json.dumps(cost))
    folder = next(runs.glob("*/latest")).resolve()
    cost = json.loads(kept.read_text())
    return folder, cost


def _memory_mb(process: "subprocess.Popen[bytes]") -> Iterator[float]:
    """Yield the resident memory of a process and its children, once a second until it ends."""
    status = Path(f"/proc/{process.pid}")
    while (status / "stat").read_text().rsplit(")", 1)[1].split()[0] != "Z":
        children = (status / "task" / str(process.pid) / "children").read_text().split()
        yield sum(_resident_mb(pid) for pid in (str(process.pid), *children))
        time.sleep(1.0)


def _resident_mb(pid: str) -> float:
    try:
        pages = int(Path(f"/proc/{pid}/statm").read_text().split()[1])
    except OSError:  # it has just ended
        return 0.0
    return pages * os.sysconf("SC_PAGE_SIZE") / 1e6


def _deviation(survey: Mission) -> FloatArray:
    """Distance (N,) of the driven path from the planned one [m]."""
    route = Route.read(survey.folder / "2-simulate" / "driven_route.geojson")
    line = shapely.LineString(route.path())
    off: FloatArray = shapely.distance(line, shapely.points(survey.real.trajectory.position[:, :2]))
    return off


def _landmarks(found: VisualOdometry) -> tuple[int, int]:
    """Count the landmarks that pass the gate of 0.5 m, and those of them first seen beyond 5 m."""
    exact = np.linalg.eigvalsh(found.sightings.covariance)[:, -1] <= LASTING.landmark_max_sigma_m**2
    far = exact & (found.sightings.range_m > LASTING.landmark_min_range_m)
    return int(exact.sum()), int(far.sum())


def treated(survey: Survey, fixes: GpsFixes | None, assumed: LocalizationConfig, treatment: str) -> Outcome:
    """Localize and map a survey with a receiver of its own luck."""
    kept: dict[str, Any] = {"gps": fixes, "base": None}
    if treatment != "joint, 4 stakes":
        kept |= {"stakes": None, "stake_sightings": None}
    localized = localize(replace(survey.recording, **kept), assumed, visual=survey.found)
    path, points = localized.trajectory, localized.points
    if treatment == "independent":
        points = replace(points, covariance=points.own_covariance)
        return judged(_around_the_prior(points, survey), survey.real, path)
    assert path.error is not None
    found = JointTerrain(path.error, survey.prior).map(points, survey.nodes)
    return judged(found.reconstruction, survey.real, path)


def _around_the_prior(points: SurfacePoints, survey: Survey) -> Reconstruction:
    """Map points around the satellite's elevations, each with an error of its own."""
    inside = np.isfinite(survey.prior.at(points.xy))
    return reconstruct(points.select(inside), survey.nodes, survey.prior)


if __name__ == "__main__":
    main("Vision mission", measure, ("numpy", "scipy", "opencv-python-headless", "numba"))
