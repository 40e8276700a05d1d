"""What a command costs a user: CPU time and peak memory of cold processes with stored compiled loops, and the reading of tables.

Every command runs first to compile and then again on the same small inputs, short ones three times, of which the fastest
counts. Maps of points on a real hill need the real data (FIRNLINE_DATA). A table of a million rows is read beside PyArrow in
the same process, each the fastest of five times.
"""

import os
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from functools import partial
from pathlib import Path

import numpy as np
import pyarrow.csv

from benchmarks.planning import random_area
from benchmarks.promise_on_real_ground.windows import FOLDER
from benchmarks.report import Row, fastest, main
from survey import Dem, Grid, SurveyArea
from survey.core import FloatArray
from survey.io.point_files import read_point_table

ROOT = Path(__file__).parents[1]
CRS = "EPSG:32608"
SIDE_M, LARGE_M = 1000.0, 9274.0
# Command, bar of CPU time [s], bar of memory [MB].
COMMANDS: dict[str, tuple[str, float, float | None]] = {
    "refusal of input: score": ("score map.tif --checkpoints none.csv", 0.7, None),
    "refusal of input: plan": ("plan none.gpkg --swaths 10", 0.7, None),
    "refusal of input: reconstruct": (f"reconstruct none.csv --crs {CRS}", 0.7, None),
    "score at checkpoints": ("score map.tif --checkpoints checkpoints.csv", 1.2, 225.0),
    "score by a raster": ("score map.tif --truth earlier.tif", 1.2, 225.0),
    "change": ("change map.tif earlier.tif --outline glacier.geojson -o change --force", 1.8, None),
    "plan of 1 km² around a prior": (
        "plan site.geojson --prior prior.tif --swaths 10 -o plan.geojson --force", 2.5, 260.0,
    ),
    "plan of 1 km² with a guarantee": (
        "plan site.geojson --prior prior.tif --require class-3 -o sure.geojson --force", 4.0, None,
    ),
    "plan of 86 km² with a guarantee": (
        "plan large.geojson --prior large.tif --require 0.5 -o large-plan.geojson --force", 120.0, 2000.0,
    ),
    "map of 5,000 points, 501² nodes": (f"reconstruct points.csv --crs {CRS} --grid 1 -o made --force", 6.0, 350.0),
}  # fmt: skip
# Points on real ground, one on 10 m², and the bar of the CPU time of their map at 1 m [s].
_GROUND = ((10_000, 10.0), (100_000, 30.0))
_GROUND_FILE = FOLDER / "dem_slovenia_lidar_1m" / "TM1_564_146.tif"
_REFUSED, _NOT_MET = 3, 5
_SHORT_S, _N_SHORT = 8.0, 3
# The peak memory of a process counts that of the one which started it, so that a small one does.
_LAUNCH = """
import os, sys
child = os.posix_spawn(sys.argv[1], sys.argv[1:], os.environ)
_, status, usage = os.wait4(child, 0)
print()
print(os.waitstatus_to_exitcode(status), usage.ru_utime + usage.ru_stime, usage.ru_maxrss)
"""


def measure(quick: bool) -> Iterator[Row]:
    """Yield the rows."""
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        _write_inputs(folder)
        start_s, _ = _warm_run("--version", folder)
        yield Row("start: --version", start_s, "s")
        for name, (command, most_s, most_mb) in COMMANDS.items():
            seconds, memory_mb = _warm_run(command, folder)
            yield Row.of(f"{name}: CPU time", seconds, "s", "<=", most_s)
            if most_mb is None:
                yield Row(f"{name}: peak memory", memory_mb, "MB")
            else:
                yield Row.of(f"{name}: peak memory", memory_mb, "MB", "<=", most_mb)
        plain_s, _ = _warm_run("plan site.geojson --spacing 20 -o plain.geojson --force", folder)
        zones_s, _ = _warm_run("plan zones.geojson --spacing 20 -o around.geojson --force", folder)
        yield Row("plan of 1 km² without zones: CPU time", plain_s, "s")
        yield Row.of(
            "plan of 1 km² with 50 zones: CPU time over that without", zones_s - plain_s, "s", "<=", 0.6
        )
        yield from _ground_maps(folder, _GROUND[:1] if quick else _GROUND)
        yield from _tables(folder, 100_000 if quick else 1_000_000)


def _write_inputs(folder: Path) -> None:
    """Write maps, a prior, areas, points and checkpoints of one smooth surface."""
    rng = np.random.default_rng(1)
    area = SurveyArea.rectangle((0.0, 0.0, SIDE_M, SIDE_M), CRS)
    area.write(folder / "site.geojson")
    random_area(0, SIDE_M).write(folder / "zones.geojson")
    SurveyArea.rectangle((300.0, 300.0, 700.0, 700.0), CRS).write(folder / "glacier.geojson")
    fine = Grid.over(area.bounds, 2.0, CRS)
    for name, raised_m in (("earlier", 0.0), ("map", 0.25)):
        noise_m = rng.normal(0.0, 0.05, fine.shape)
        Dem.on(fine, _height(fine.xy).reshape(fine.shape) + raised_m + noise_m).write(folder / f"{name}.tif")
    SurveyArea.rectangle((0.0, 0.0, LARGE_M, LARGE_M), CRS).write(folder / "large.geojson")
    for name, side_m in (("prior", SIDE_M), ("large", LARGE_M)):
        coarse = Grid.over((-300.0, -300.0, side_m + 300.0, side_m + 300.0), 30.0, CRS)
        prior = _height(coarse.xy).reshape(coarse.shape) + rng.normal(0.0, 1.0, coarse.shape)
        Dem.on(coarse, prior).write(folder / f"{name}.tif")
    _write_points(folder / "points.csv", rng.uniform(0.0, 500.0, (5000, 2)), rng)
    _write_points(folder / "checkpoints.csv", rng.uniform(20.0, SIDE_M - 20.0, (60, 2)), rng)


def _height(xy: FloatArray) -> FloatArray:
    """Return the height of the surface at places (N, 2) [m]."""
    x, y = xy.T
    height: FloatArray = 900.0 + 10.0 * np.sin(x / 60.0) + 8.0 * np.cos(y / 50.0)
    return height


def _write_points(file: Path, xy: FloatArray, rng: np.random.Generator) -> None:
    """Write measured points with their standard deviation."""
    _write_table(file, xy, _height(xy) + rng.normal(0.0, 0.05, len(xy)))


def _write_table(file: Path, xy: FloatArray, z: FloatArray) -> None:
    """Write points (N, 2) and heights (N,) with a standard deviation of 0.05 m."""
    rows = (f"{x:.3f},{y:.3f},{height:.3f},0.05\n" for (x, y), height in zip(xy, z, strict=True))
    file.write_text("x_m,y_m,z_m,sigma_z_m\n" + "".join(rows), encoding="utf-8")


def _warm_run(command: str, folder: Path) -> tuple[float, float]:
    """Return CPU time [s] and peak memory [MB] of a command after a first run, which stores compiled loops.

    Of short commands it is the fastest of three runs: what other users of the machine add is left out.
    """
    _run(command, folder)
    runs = [_run(command, folder)]
    while runs[0][0] < _SHORT_S and len(runs) < _N_SHORT:
        runs.append(_run(command, folder))
    return min(runs)


def _run(command: str, folder: Path) -> tuple[float, float]:
    """Return CPU time [s] and peak memory [MB] of a command in a process of its own."""
    settings = {
        "PYTHONPATH": str(ROOT),
        "NUMBA_CACHE_DIR": str(folder / "loops"),
        "MPLBACKEND": "Agg",
        "OPENBLAS_NUM_THREADS": "1",
        "OMP_NUM_THREADS": "1",
    }
    inherited = {name: value for name, value in os.environ.items() if name != "PYTHONDONTWRITEBYTECODE"}
    words = [sys.executable, "-c", _LAUNCH, sys.executable, "-m", "firnline", *command.split()]
    run = subprocess.run(
        words, cwd=folder, env=inherited | settings, capture_output=True, text=True, check=True
    )
    code, seconds, kilobytes = run.stdout.splitlines()[-1].split()
    if int(code) not in (_REFUSED if "none." in command else 0, _NOT_MET):
        raise SystemExit(f"{command} ended with {code}: {run.stderr}")
    return float(seconds), float(kilobytes) * 1024 / 1e6


def _ground_maps(folder: Path, cases: Sequence[tuple[int, float]]) -> Iterator[Row]:
    """Yield the CPU time of maps of points on a real hill, where the real data are."""
    if not _GROUND_FILE.exists():
        return
    terrain, rng = Dem.read(_GROUND_FILE), np.random.default_rng(3)
    for n_points, most_s in cases:
        side_m = np.sqrt(10.0 * n_points) - 4.0
        xy = rng.uniform(2.0, side_m, (n_points, 2)) + (terrain.x.min(), terrain.y.min())
        heights = terrain.at(xy) + rng.normal(0.0, 0.05, n_points)
        _write_table(folder / "ground.csv", xy, heights)
        command = "reconstruct ground.csv --crs EPSG:3794 --grid 1 --no-pictures -o ground --force"
        seconds, memory_mb = _warm_run(command, folder)
        name = f"map of {n_points:,} points of a hill at 1 m, without pictures"
        yield Row.of(f"{name}: CPU time", seconds, "s", "<=", most_s)
        yield Row(f"{name}: peak memory", memory_mb, "MB")


def _tables(folder: Path, n_rows: int) -> Iterator[Row]:
    """Yield the CPU time of reading tables of text, and that over PyArrow's."""
    rng = np.random.default_rng(2)
    xy = rng.uniform(0.0, 2000.0, (n_rows, 2)) + (500_000.0, 6_700_000.0)
    columns = [xy[:, 0], xy[:, 1], _height(xy), np.full(n_rows, 0.02)]
    cells = [[f"{value:.3f}" for value in column] for column in columns]
    for name, header, mark, decimal in (
        ("commas", "x_m,y_m,z_m,sigma", ",", "."),
        ("an export with semicolons and decimal commas", "Easting;Northing;Elevation;SDV", ";", ","),
        ("blanks without a header", "", " ", "."),
    ):
        file = folder / ("table.csv" if header else "table.xyz")
        used = cells if header else cells[:3]
        rows = (mark.join(row).replace(".", decimal) + "\n" for row in zip(*used, strict=True))
        file.write_text((header + "\n" if header else "") + "".join(rows), encoding="utf-8")
        table, own_s = fastest(partial(read_point_table, file), 5)
        options = (
            pyarrow.csv.ReadOptions(use_threads=False, autogenerate_column_names=not header),
            pyarrow.csv.ParseOptions(delimiter=mark),
            pyarrow.csv.ConvertOptions(decimal_point=decimal),
        )
        _, arrow_s = fastest(partial(pyarrow.csv.read_csv, file, *options), 5)
        assert len(table.columns["z_m"]) == n_rows
        yield Row.of(f"{n_rows:,} rows, {name}: CPU time", own_s, "s", "<=", 0.6 * n_rows / 1e6)
        yield Row(f"{n_rows:,} rows, {name}: over PyArrow", own_s / arrow_s, "x")


if __name__ == "__main__":
    main("First contact", measure, ("numpy", "scipy", "pyarrow", "numba", "matplotlib"))
