"""Maps of made surveys, compared with their ground."""

import json
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import NamedTuple

import numpy as np
import rasterio
from rasterio.windows import Window

from benchmarks.whole_glacier.made_survey import MadeSurvey
from survey.core.arrays import FloatArray
from survey.data.surface_points import SurfacePoints

N_CONTROL_PER_KM2 = 4.0
_ROWS = 500
_MEASURING = """
import json, os, subprocess, sys
process = subprocess.Popen(sys.argv[2:], stdout=subprocess.DEVNULL)
_, status, used = os.wait4(process.pid, 0)
with open(sys.argv[1], "w") as report:
    json.dump([used.ru_utime + used.ru_stime, used.ru_maxrss], report)
sys.exit(os.waitstatus_to_exitcode(status) != 0)
"""


class Judged(NamedTuple):
    """Errors of a map against the ground: RMSE, stated RMSE, mean error [m], coverage of 95 %, number of cells."""

    rmse_m: float
    stated_m: float
    mean_m: float
    coverage_95: float
    n_cells: int


class Used(NamedTuple):
    """CPU time of a command and its children [s], and the largest memory of one process [MB]."""

    cpu_s: float
    memory_mb: float


def control_file(made: MadeSurvey, folder: Path) -> Path:
    """Write the control points of a survey, and return their file."""
    n = max(int(N_CONTROL_PER_KM2 * made.width_m * made.height_m / 1e6), 4)
    xyz, sigma_m = made.control(n)
    file = folder / "control.csv"
    SurfacePoints(xyz, sigma_m=sigma_m, crs="EPSG:32608").write(file)
    return file


def command(files: list[Path], out: Path, *options: str) -> list[str]:
    """Return the command that maps files in tiles."""
    return [
        *(sys.executable, "-m", "firnline.cli.main", "reconstruct", *map(str, files)),
        *("--tiles", "--quiet", "--out", str(out), *options),
    ]


def used_by(arguments: list[str]) -> Used:
    """Run a command, and return what it and its own processes used.

    A small process starts the command: the peak of a child's memory begins with that of the process that starts it.
    """
    with tempfile.NamedTemporaryFile("r", encoding="utf-8") as report:
        subprocess.run([sys.executable, "-S", "-c", _MEASURING, report.name, *arguments], check=True)
        cpu_s, memory_kib = json.load(report)
    return Used(cpu_s, memory_kib * 1024 / 1e6)


def judged(made: MadeSurvey, mosaic: Path) -> Judged:
    """Return the errors of a map, read strip by strip."""
    sums, inside = np.zeros(4), 0
    with rasterio.open(mosaic) as source:
        for first in range(0, source.height, _ROWS):
            window = Window(0, first, source.width, min(_ROWS, source.height - first))
            height, std = source.read((1, 2), window=window, masked=True).filled(np.nan).astype(np.float64)
            error = height - _truth(made, source.transform, window)
            known = np.isfinite(error)
            error, sigma = error[known], std[known]
            sums += [len(error), error.sum(), error @ error, sigma @ sigma]
            inside += int((np.abs(error) <= 1.96 * sigma).sum())
    n = sums[0]
    return Judged(
        float(np.sqrt(sums[2] / n)),
        float(np.sqrt(sums[3] / n)),
        float(sums[1] / n),
        inside / float(n),
        int(n),
    )


def _truth(made: MadeSurvey, transform: rasterio.Affine, window: Window) -> FloatArray:
    column, row = np.meshgrid(np.arange(window.width) + 0.5, window.row_off + np.arange(window.height) + 0.5)
    x, y = transform.c + transform.a * column, transform.f + transform.e * row
    return made.heights(x.ravel(), y.ravel()).reshape(x.shape)
