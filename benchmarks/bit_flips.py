"""Flip random bits of everything that is written with a checksum: ``python -m benchmarks.bit_flips --flips 200``.

A run, a Monte Carlo study, a study's record, a map, terrain models and exports are written small. Of each file
single bits are flipped, then it is read the way the commands read it. The answer counts as refused, as the
same value (the bit meant nothing), or as another value, which must not happen.
"""

import argparse
import json
import shutil
import tempfile
from collections import Counter
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

import survey
from benchmarks.small_inputs import STUDY
from benchmarks.writer import TABLES, Run
from firnline.actions.runs import logged_to
from papers.studies import is_complete, record
from sim.config.mission import MissionConfig
from sim.mission.runs import open_run
from sim.mission.stages import run_mission
from sim.montecarlo.config import read_study
from sim.montecarlo.results import read_trials
from sim.montecarlo.study import run_study
from survey.core.config import validated
from survey.core.documents import read_log, read_record
from survey.core.errors import FirnlineError
from survey.core.run_folder import STAGES, RunFolder
from survey.data.path_error import PathError
from survey.io.arrays_file import read_npz, write_npz

RESULT = TABLES / "bit_flips.json"
MISSION = {
    "schema_version": 1,
    "name": "small",
    "terrain": {"source": "random", "size_m": 150.0, "step_m": 3.0, "length_scale_m": 60.0},
    "planner": {"pattern": "lawnmower", "swaths": 2},
    "sensors": {"landmarks_per_m": 0.5},
    "reconstruction": {"grid_step_m": 5.0, "gp": {"fit": False, "variance_m2": 4.0, "length_scale_m": 40.0}},
}


class Reading(NamedTuple):
    """A file, and how the commands read it: the answer is compared by its JSON text."""

    group: str
    file: Path
    read: Callable[[], Any]


def readings(folder: Path) -> Iterator[Reading]:
    """Write everything once and yield each file with its reader."""
    yield from _of_a_run(folder)
    yield from _of_a_study(folder)
    yield from _of_a_map(folder)


def _of_a_run(folder: Path) -> Iterator[Reading]:
    mission = validated(MissionConfig, MISSION, "the benchmark")
    run = open_run(mission, folder / "runs")
    with logged_to(run.log_file, 0):
        run_mission(mission, run)
    yield Reading("run: manifest and config", run.path / "manifest.json", lambda: _shown(run))
    yield Reading("run: manifest and config", run.path / "config.toml", lambda: _shown(run))
    yield Reading("run: log", run.log_file, lambda: read_log(run.log_file))
    for file in sorted(run.path.glob("?-*/**/*")):
        if file.is_file():
            yield Reading("run: files of stages", file, lambda: _shown(run))
    error = run.folder("localize") / "trajectory.error.npz"
    yield Reading("run: file by itself", error, lambda: PathError.read(error).information.toarray().tolist())
    for dem in sorted(run.path.glob("?-*/**/dem.tif")):
        yield Reading("run: file by itself", dem, lambda dem=dem: survey.Dem.read(dem).elevation.tolist())


def _shown(run: RunFolder) -> Any:
    """Return what `show` and `report` rely on, after all checks."""
    for stage in STAGES:
        run.verify(stage)
    return [run.config_text(), run.manifest, sorted(str(f) for f in run.path.rglob("*"))]


def _of_a_study(folder: Path) -> Iterator[Reading]:
    (folder / "study.toml").write_text(STUDY)
    study, place = read_study(folder / "study.toml"), folder / "study"
    run_study(study, place, engine="serial")
    for name in sorted(read_record(place)["files_sha256"]):
        yield Reading("study: results", place / name, lambda: _recorded(place))
    yield Reading("study: results", place / "made.json", lambda: _recorded(place))
    for table in [*sorted((place / "blocks").glob("*")), place / "trials.parquet"]:
        yield Reading("study: tables", table, lambda table=table: read_trials(table).to_pylist())
    cache = folder / "cache"
    cache.mkdir()
    shutil.copy(place / "summary.csv", cache)
    record(cache, quick=True, facts={}, old={})
    for file in sorted(cache.iterdir()):
        # A study that does not count as complete is made again: that is the refusal.
        yield Reading("study: cache", file, lambda: is_complete(cache, quick=True) or _refuse())


def _recorded(place: Path) -> Any:
    return {name: (place / name).read_bytes().hex() for name in read_record(place)["files_sha256"]}


def _refuse() -> None:
    raise survey.InputError("the study is made again.")


def _of_a_map(folder: Path) -> Iterator[Reading]:
    rng = np.random.default_rng(1)
    xyz = np.column_stack([rng.uniform(0.0, 60.0, (40, 2)), rng.normal(size=40)])
    points = survey.SurfacePoints(xyz, sigma_m=0.1, crs="EPSG:32608")
    grid = survey.Grid((0.0, 0.0, 60.0, 60.0), 5.0, "EPSG:32608")
    result = survey.reconstruct(points, grid, method="tin")
    (folder / "map").mkdir()
    result.write(folder / "map")
    for file in sorted((folder / "map").iterdir()):
        yield Reading("map", file, lambda: _map(folder / "map"))
    result.mean.write(folder / "export.tif")
    yield Reading("export", folder / "export.tif", lambda: _dem(folder / "export.tif"))
    for suffix in (".las", ".laz", ".ply"):
        file = folder / f"points{suffix}"
        points.write(file)
        yield Reading(
            "export", file, lambda file=file: survey.SurfacePoints.read(file, sigma_m=0.1).xyz.tolist()
        )
    write_npz(folder / "model.npz", {"z": xyz, "facts": np.frombuffer(b'{"a": 1}', dtype=np.uint8)})
    yield Reading("model", folder / "model.npz", lambda: _arrays(folder / "model.npz"))


def _dem(file: Path) -> Any:
    dem = survey.Dem.read(file)
    return [dem.elevation.tolist(), list(dem.transform), dem.vertical_datum, dem.crs.to_wkt()]


def _map(folder: Path) -> Any:
    found = survey.Reconstruction.read(folder)
    rasters = [found.mean.elevation.tolist(), found.std.elevation.tolist(), found.support.tolist()]
    return [rasters, found.method, dict(found.hyperparameters), dict(found.diagnostics)]


def _arrays(file: Path) -> Any:
    return {name: values.tolist() for name, values in read_npz(file, "the model", "save it again").items()}


def text_of(answer: Any) -> str:
    """Return an answer in a form that can be compared."""
    return json.dumps(answer, sort_keys=True, default=str)


def outcomes(reading: Reading, n_flips: int, rng: np.random.Generator) -> Counter[str]:
    """Flip bits of one file, one at a time; return how often its reader refused, agreed or erred."""
    right, stored = text_of(reading.read()), reading.file.read_bytes()
    counts: Counter[str] = Counter()
    for bit in rng.choice(8 * len(stored), min(n_flips, 8 * len(stored)), replace=False):
        damaged = bytearray(stored)
        damaged[bit // 8] ^= 1 << (bit % 8)
        reading.file.write_bytes(bytes(damaged))
        try:
            counts["same value" if text_of(reading.read()) == right else "other value"] += 1
        except FirnlineError:
            counts["refused"] += 1
    reading.file.write_bytes(stored)
    return counts


def main() -> None:
    """Print and store the counts."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--flips", type=int, default=200, help="bits to flip in each group of files")
    n_flips = parser.parse_args().flips
    run = Run.begin(main, RESULT)
    rng = np.random.default_rng(20261122)
    table: dict[str, Counter[str]] = {}
    with tempfile.TemporaryDirectory() as place:
        every = list(readings(Path(place)))
        in_group = Counter(reading.group for reading in every)
        for reading in every:
            share = -(-n_flips // in_group[reading.group])
            counts = outcomes(reading, share, rng)
            table.setdefault(reading.group, Counter()).update(counts)
            if counts["other value"]:
                print(f"OTHER VALUE: {reading.file.name} {counts}")
    for group, counts in table.items():
        print(
            f"{group:<26}",
            "  ".join(f"{counts[name]:5d} {name}" for name in ("refused", "same value", "other value")),
        )
    content = {"command": f"python -m benchmarks.bit_flips --flips {n_flips}"}
    rows = {
        group: {name: counts[name] for name in ("refused", "same value", "other value")}
        for group, counts in table.items()
    }
    run.write({**content, "flips": rows})


if __name__ == "__main__":
    main()
