"""Run the benchmark of maps in tiles.

``python -m benchmarks.whole_glacier [--km2 0.5 1 2] [--density 2] [--quick]``: areas, and points for each square metre
of a strip. ``--km2 25 --density 2.9`` has 10⁸ points.
"""

import argparse
import os
import tempfile
import time
from collections.abc import Callable, Iterable, Iterator
from functools import partial
from pathlib import Path

import numpy as np
import rasterio

from benchmarks.report import Row, main
from benchmarks.stored_parts import parts_folder, stored_rows
from benchmarks.whole_glacier.kills import digest, killed
from benchmarks.whole_glacier.made_survey import MadeSurvey
from benchmarks.whole_glacier.mapping import (
    above_triangles_m,
    command,
    control_file,
    judged,
    offset_of,
    used_by,
)
from benchmarks.whole_glacier.peers import PeerError, gdal_grid

_SEEDS = (101, 102, 103)
_DATA = Path(os.environ.get("FIRNLINE_DATA", "../shared/data"))
_RAW_OFFSET_M = 0.100
_N_KILLS = 10


def rows(sizes_km2: list[float], density: float, quick: bool) -> Iterator[Row]:
    """Yield all rows; parts that are done are stored, so that a run that was broken off goes on."""
    place = parts_folder("whole-glacier", "survey/reconstruction", "benchmarks/whole_glacier")
    parts: dict[str, Callable[[Path], Iterable[Row]]] = {"real": real_strips}
    sizes = sizes_km2[:1] if quick else sizes_km2
    parts |= {f"made_{km2:g}_{density:g}": partial(made_survey, km2=km2, density=density) for km2 in sizes}
    parts |= {"seams": partial(seams, density=density), "peers": partial(peers, density=density)}
    parts |= {} if quick else {"workers": partial(workers_and_kills, density=density)}
    found: list[Row] = []
    for part, make in parts.items():
        with tempfile.TemporaryDirectory(prefix="firnline-tiles-") as folder:
            own = stored_rows(place / f"{part}.json", partial(make, Path(folder)))
        found += own
        yield from own
    yield from exponent(found, sizes)


def real_strips(folder: Path) -> Iterator[Row]:
    """Yield the offset between two real strips."""
    file = _DATA / "dem_gullies_santacruz_pozo" / "Blanca_in_Pozo_cl2_SC12.laz"
    if not file.exists():
        return
    used_by(command([file], folder / "real", "--workers", "1"))
    offset_m, sigma_m = offset_of(folder / "real", ["8705", "8706"])
    yield Row("Santa Cruz: strip 8705 above 8706 in their overlap", offset_m, "m")
    yield Row("Santa Cruz: its standard deviation", sigma_m, "m")
    points_m = above_triangles_m(file, 8705, 8706)
    yield Row("Santa Cruz: median of points above triangles of the other strip", points_m, "m")
    yield Row.of(
        "Santa Cruz: distance from it in standard deviations",
        abs(offset_m - points_m) / sigma_m,
        "",
        "<=",
        1.0,
    )
    # Points of the two strips lie at other places of a cell, which the slope turns into heights.
    raw = abs(offset_m - _RAW_OFFSET_M) / sigma_m
    yield Row.of("Santa Cruz: distance from the median difference of raw cells, 0.100 m", raw, "", "<=", 1.0)


def made_survey(folder: Path, km2: float, density: float) -> Iterator[Row]:
    """Yield coverage, errors, CPU time and memory of a made survey of a size."""
    made = MadeSurvey(_SEEDS[0], 1000.0 * np.sqrt(km2), 1000.0 * np.sqrt(km2), density)
    files = made.write(folder / "made")
    options = ["--control", str(control_file(made, folder)), "--workers", "2"]
    began = time.perf_counter()
    used = used_by(command(files, folder / "map", *options))
    found, what = judged(made, folder / "map" / "dem.vrt"), f"{km2:g} km²"
    yield Row.of(f"{what}: coverage of 95 % intervals, at least", found.coverage_95, "", ">=", 0.93)
    yield Row.of(f"{what}: coverage of 95 % intervals, at most", found.coverage_95, "", "<=", 0.97)
    yield Row(f"{what}: RMSE", found.rmse_m, "m")
    yield Row(f"{what}: stated RMSE", found.stated_m, "m")
    yield Row(f"{what}: CPU time", used.cpu_s, "s")
    yield Row(f"{what}: time on a machine in use", (time.perf_counter() - began) / 60.0, "min")
    yield Row.of(f"{what}: memory of the largest process", used.memory_mb, "MB", "<=", 4000.0)


def exponent(found: list[Row], sizes_km2: list[float]) -> Iterator[Row]:
    """Yield the exponent of the CPU time with the number of points, of three sizes or more."""
    times = [row.value for row in found if row.name.endswith(": CPU time")]
    if len(times) > 2:
        slope = float(np.polyfit(np.log(sizes_km2), np.log(times), 1)[0])
        yield Row.of("exponent of the CPU time with the number of points", slope, "", "<=", 1.05)


def seams(folder: Path, density: float) -> Iterator[Row]:
    """Yield differences beside the edges of tiles to one big tile."""
    made = MadeSurvey(_SEEDS[1], 600.0, 600.0, density)
    files = made.write(folder / "seams")
    maps = []
    for cells in (200, 600):
        out = folder / f"seams_{cells}"
        used_by(command(files, out, "--workers", "1", "--set", f"tiles.tile_cells={cells}"))
        with rasterio.open(out / "dem.vrt") as source:
            maps.append(source.read(masked=True).filled(np.nan))
    edges = np.zeros(maps[0].shape[1:], bool)
    for at in (200, 400):
        edges[:, at - 2 : at + 2], edges[-at - 2 : -at + 2] = True, True
    height_m, std_m = (np.nanmean(np.abs(maps[0] - maps[1])[band][edges]) for band in (0, 1))
    yield Row.of("seam: mean difference of heights to one tile", float(height_m), "m", "<=", 1e-3)
    share = float(std_m / np.nanmean(maps[1][1][edges]))
    yield Row.of("seam: mean difference of standard deviations", share, "", "<=", 0.02)


def peers(folder: Path, density: float) -> Iterator[Row]:
    """Yield error and CPU time beside gdal_grid's."""
    made = MadeSurvey(_SEEDS[2], 500.0, 500.0, density)
    files = made.write(folder / "peers")
    used = used_by(
        command(files, folder / "own", "--workers", "1", "--control", str(control_file(made, folder)))
    )
    own = judged(made, folder / "own" / "dem.vrt")
    try:
        found = gdal_grid(made, files, folder)
    except PeerError:
        return
    for name, (rmse_m, peer_used) in found.items():
        yield Row(f"gdal_grid, {name}: RMSE", rmse_m, "m")
        yield Row.of(f"RMSE over that of gdal_grid, {name}", own.rmse_m / rmse_m, "", "<=", 0.9)
        yield Row(
            f"CPU time over that of gdal_grid, {name}", used.cpu_s / peer_used.cpu_s, "", "<= 2 (triangles)"
        )


def workers_and_kills(folder: Path, density: float) -> Iterator[Row]:
    """Yield the gain by a second worker, and whether a map that was killed ten times has the same bytes."""
    made = MadeSurvey(_SEEDS[2], 900.0, 600.0, density)
    files = made.write(folder / "workers")
    seconds = []
    for n in (1, 2):
        began = time.perf_counter()
        used_by(
            command(
                files,
                folder / f"workers_{n}",
                "--workers",
                str(n),
                "--set",
                "tiles.tile_cells=300",
                "--set",
                "tiles.coarse_cells=20",
            )
        )
        seconds.append(time.perf_counter() - began)
    yield Row.of("time with one worker over that with two", seconds[0] / seconds[1], "", ">=", 1.8)
    arguments = command(
        files,
        folder / "killed",
        "--workers",
        "2",
        "--set",
        "tiles.tile_cells=300",
        "--set",
        "tiles.coarse_cells=20",
    )
    n_kills = killed(arguments, _N_KILLS, seconds[1], 5)
    same = digest(folder / "killed") == digest(folder / "workers_1") == digest(folder / "workers_2")
    yield Row.of(f"same bytes after {n_kills} kills", float(same), "", ">=", 1.0)


def run() -> None:
    """Run the benchmark from the command line."""
    parser = argparse.ArgumentParser(add_help=False)
    parser.add_argument("--km2", type=float, nargs="+", default=[0.5, 1.0, 2.0])
    parser.add_argument("--density", type=float, default=2.0)
    chosen, rest = parser.parse_known_args()
    main("whole glacier", partial(rows, chosen.km2, chosen.density), arguments=rest)


if __name__ == "__main__":
    run()
