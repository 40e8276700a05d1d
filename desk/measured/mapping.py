"""Map of real measurements, as ``firnline reconstruct`` makes it, and its score at checkpoints."""

import shlex
from pathlib import Path
from typing import Any

from desk.measured.files import SIGMA_M, read_checkpoints
from desk.runs.layers import map_layers
from firnline.cli.mapping.inputs import map_request
from firnline.cli.mapping.options import ReconstructOptions
from firnline.cli.mapping.outputs import write_map
from firnline.cli.mapping.points import map_points
from survey.core.arrays import Progress
from survey.core.text import round_number
from survey.data.area import SurveyArea
from survey.reconstruction.terrain_map import Reconstruction
from survey.scoring import compare, score_at
from survey.scoring.standards.map_classes import own_claim

_NODES_ALONG = 150.0
_STANDARD = "asprs-edition-2"


def measured_map(
    area: SurveyArea,
    points: Path,
    prior: Path,
    folder: Path,
    *,
    checkpoints: Path | None,
    progress: Progress,
) -> dict[str, Any]:
    """Map measured points over the area, and score the map.

    Returns: the pictures ``elevation`` and ``sigma``, ``sentences`` about the map's error, and the
    ``commands`` that do the same.
    """
    steps = 3 if checkpoints is None else 4
    area.write(folder / "area.gpkg")
    options = _options(area, points, prior, folder)
    progress("mapping the points", 1, steps)
    made = map_points(map_request(options))
    write_map(made, options.out, rays=False, max_slope_deg=None)
    progress("drawing the map", steps - 1, steps)
    sentences, commands = own_claim(made.reconstruction), [_command(options)]
    if checkpoints is not None:
        sentences += _judged(made.reconstruction, checkpoints, area)
        commands.append(_score_command(checkpoints))
    return {
        "sentences": sentences,
        "commands": commands,
        "folder": str(options.out),
        **map_layers(made.reconstruction),
    }


def _options(area: SurveyArea, points: Path, prior: Path, folder: Path) -> ReconstructOptions:
    xmin, ymin, xmax, ymax = area.bounds
    return ReconstructOptions(
        sources=[points],
        prior=prior,
        step_m=round_number(max(xmax - xmin, ymax - ymin) / _NODES_ALONG),
        area=folder / "area.gpkg",
        crs=area.crs.to_string(),
        sigma_m=SIGMA_M,
        out=folder / "map",
        quiet=True,
    )


def _judged(map_: Reconstruction, checkpoints: Path, area: SurveyArea) -> list[str]:
    """Return in sentences how the map errs at checkpoints."""
    errors = compare(map_.mean, read_checkpoints(checkpoints, map_.mean.crs), area)
    judged = score_at(errors, (_STANDARD,))
    low, high = judged.interval.low_m, judged.interval.high_m
    facts = judged.to_dict()["elevation"]
    first = f"At {facts['n']} checkpoints the map has an RMSE of {facts['rmse_m']:.3f} m ({low:.3f} to {high:.3f} m with 95 %)."
    return [first, *(finding.sentence for finding in judged.assessments)]


def _command(options: ReconstructOptions) -> str:
    words = ["firnline", "reconstruct", options.sources[0].name, "--prior", str(options.prior)]
    words += ["--area", "area.gpkg", "--grid", f"{options.step_m:g}", "--crs", str(options.crs)]
    return shlex.join([*words, "--sigma", f"{options.sigma_m:g}", "-o", "map"])


def _score_command(checkpoints: Path) -> str:
    words = ["firnline", "score", "map/dem.tif", "--checkpoints", checkpoints.name, "--area", "area.gpkg"]
    return shlex.join([*words, "--sigma", f"{SIGMA_M:g}"])
