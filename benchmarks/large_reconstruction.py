"""Map 1,000,000 points over 5 × 5 km at 1 m with plain ``firnline reconstruct``: time, stated time, memory and error.

Run with ``python -m benchmarks.large_reconstruction``; the result goes to ``results/benchmarks``.
"""

import json
import os
import re
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

from benchmarks.writer import TABLES, Run
from survey import Dem, Grid, SurfacePoints
from survey.terrain import random_dem

N_POINTS, SIDE_M, STEP_M, CELL_M = 1_000_000, 5000.0, 1.0, 5.0
SIGMA_M = 0.1
CRS = "EPSG:32608"
RESULT = TABLES / "large_reconstruction.json"
# Rough and smooth ground.
FAMILIES = ("matern-3/2", "squared-exponential")


def main() -> None:
    """Measure every family and write the result."""
    run = Run.begin(main, RESULT)
    run.write({family: measure(family) for family in FAMILIES})
    print(RESULT.read_text(encoding="utf-8"))


def measure(family: str) -> dict[str, float | str | None]:
    """Map points of one kind of terrain by the command."""
    terrain = random_dem(
        family,
        Grid((0.0, 0.0, SIDE_M, SIDE_M), CELL_M, CRS),
        np.random.default_rng(1),
        relief_m=200.0,
        length_scale_m=220.0,
    )
    with tempfile.TemporaryDirectory() as folder:
        place = Path(folder)
        _write_points(terrain, place / "points.ply")
        load_before = os.getloadavg()[0]
        began = time.perf_counter()
        said = _reconstructed(place)
        seconds = time.perf_counter() - began
        mapped = Dem.read(place / "map" / "dem.tif")
        diagnostics = json.loads((place / "map" / "reconstruction.json").read_text())["diagnostics"]
    usage = resource.getrusage(resource.RUSAGE_CHILDREN)
    error = mapped.elevation[::7, ::7] - terrain.at(mapped.xy).reshape(mapped.shape)[::7, ::7]
    return {
        "n_points": N_POINTS,
        "n_nodes": mapped.elevation.size,
        "engine": diagnostics["engine"]["name"],
        "wall_s": round(seconds, 1),
        "stated_s": _stated_s(said),
        "peak_gb": round(usage.ru_maxrss / 1e6, 2),
        "load_before": round(load_before, 2),
        "load_after": round(os.getloadavg()[0], 2),
        "rmse_m": round(float(np.sqrt(np.nanmean(error**2))), 4),
        "known_share": round(float(np.isfinite(mapped.elevation).mean()), 6),
    }


def _write_points(terrain: Dem, file: Path) -> None:
    rng = np.random.default_rng(2)
    xy = rng.uniform(0.0, SIDE_M, (N_POINTS, 2))
    z = terrain.at(xy) + SIGMA_M * rng.standard_normal(N_POINTS)
    SurfacePoints(np.column_stack([xy, z]), sigma_m=SIGMA_M, crs=CRS).write(file)


def _reconstructed(place: Path) -> str:
    """Run the command, and return what it wrote to stderr."""
    command = [sys.executable, "-m", "firnline.cli.main", "reconstruct", str(place / "points.ply")]
    options = ["--crs", CRS, "--grid", str(STEP_M), "-o", str(place / "map")]
    done = subprocess.run([*command, *options], check=True, capture_output=True, text=True)
    return done.stderr


def _stated_s(said: str) -> float | None:
    """Return the time that the command stated beforehand [s], or None where it stated none."""
    found = re.search(r"takes about (\d+) (min|s)", said)
    return None if found is None else float(found[1]) * (60.0 if found[2] == "min" else 1.0)


if __name__ == "__main__":
    main()
