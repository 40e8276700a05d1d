"""Coverage over many small surveys of two strips and four control points: the level of each is one draw of their errors."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from benchmarks.report import Row
from benchmarks.whole_glacier.made_survey import CRS_NAME, MadeSurvey
from benchmarks.whole_glacier.mapping import Judged, judged
from benchmarks.whole_glacier.maps import coverage_rows
from survey.reconstruction.tiled.job import Control, TiledConfig, tiled_job
from survey.reconstruction.tiled.survey_map import map_in_tiles

_SEEDS = range(201, 241)
_STRIPS_M = (0.1, 0.2, 0.3)
_SIDES_M = (700.0, 350.0)
_N_CONTROL = 4


def small_surveys(folder: Path, density: float) -> Iterator[Row]:
    """Yield the coverage over forty surveys of a quarter of a square kilometre, each with errors of its own."""
    found = [
        mapped(MadeSurvey(seed, *_SIDES_M, density, _STRIPS_M[k % len(_STRIPS_M)]), folder / str(seed))
        for k, seed in enumerate(_SEEDS)
    ]
    shares = np.array([one.coverage_95 for one in found])
    yield from coverage_rows(
        f"{len(found)} surveys of 0.25 km², strip errors of 0.1 to 0.3 m", float(shares.mean()), has_bar=True
    )
    error = float(shares.std(ddof=1) / np.sqrt(len(found)))
    yield Row(f"{len(found)} surveys of 0.25 km²: standard error of the coverage", error, "")
    ratio = np.sqrt(np.mean([one.rmse_m**2 for one in found]) / np.mean([one.stated_m**2 for one in found]))
    yield Row(f"{len(found)} surveys of 0.25 km²: RMSE over stated RMSE", float(ratio), "")


def mapped(made: MadeSurvey, folder: Path) -> Judged:
    """Map a made survey in this process, and return the errors of the map."""
    control = Control(*made.control(_N_CONTROL))
    job = tiled_job(made.write(folder), folder / "map", TiledConfig(), crs=CRS_NAME, control=control)
    map_in_tiles(job, lambda work, pieces: ((piece, work(piece)) for piece in pieces))
    return judged(made, folder / "map" / "dem.vrt")
