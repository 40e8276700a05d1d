"""Real measurements: their files, the map made from them, its score, and the swath to drive next."""

import re
import shlex
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any, cast

from pyproj import CRS

from desk.plan.dropped import SIGMA_M, thinned_points
from desk.runs import layers_of
from firnline.actions import ScoreRequest, score
from firnline.actions.guaranteeing import swath_advice
from firnline.actions.mapping import reconstruct
from firnline.actions.requests import ReconstructRequest
from planners.guarantee.requirement import MapRequirement
from survey import ConfigError, Dem, InputError, Route, SurfacePoints, SurveyArea
from survey.core import Progress, length_text, replacing, round_number
from survey.scoring import Checkpoints
from survey.scoring.standards.assessment import CheckpointScore
from survey.scoring.standards.map_classes import own_claim

_NOT_IN_NAMES = re.compile(r"[^A-Za-z0-9_.-]+")
_MOST_LETTERS = 60


def store_measured(role: str, name: str, content: bytes, crs: CRS, folder: Path) -> dict[str, Any]:
    """Read a file of measurements, and store it where it can be read.

    Returns: ``file`` (its name there), ``kind`` and what the map shows of it.
    """
    if role not in _READERS:
        raise ConfigError(f"the role {role[:40]!r} is none of {', '.join(_READERS)}.")
    stored = _plain_name(name)
    with tempfile.TemporaryDirectory(prefix="firnline-desk-") as place:
        file = Path(place) / stored
        file.write_bytes(content)
        try:
            found = _READERS[role](file, crs)
        except InputError as error:
            raise InputError(str(error).replace(str(file), stored)) from error
    folder.mkdir(parents=True, exist_ok=True)
    with replacing(folder / stored) as draft:
        draft.write_bytes(content)
    return {"file": stored, "role": role, **found}


def show_measured(role: str, file: Path, crs: CRS) -> dict[str, Any]:
    """Return what the map shows of a stored file; see `store_measured`."""
    return {"file": file.name, "role": role, **_READERS[role](file, crs)}


def read_checkpoints(file: Path, crs: CRS) -> Checkpoints:
    """Read checkpoints; heights without a stated uncertainty are taken to err by 0.05 m."""
    return Checkpoints.read(file, crs=crs, sigma_m=SIGMA_M)


def _plain_name(name: str) -> str:
    """Return a name without folders and special letters."""
    bare = Path(name.replace("\\", "/")).name
    stem = _NOT_IN_NAMES.sub("-", Path(bare).stem)[:_MOST_LETTERS].strip("-._") or "measured"
    return f"{stem}{_NOT_IN_NAMES.sub('', Path(bare).suffix)[:10].lower()}"


def _shown_points(file: Path, crs: CRS) -> dict[str, Any]:
    points = SurfacePoints.read(file, crs=crs, sigma_m=SIGMA_M)
    return {"kind": "points", **thinned_points(points.xyz)}


def _shown_checkpoints(file: Path, crs: CRS) -> dict[str, Any]:
    return {"kind": "points", **thinned_points(read_checkpoints(file, crs).xyz)}


def _shown_route(file: Path, crs: CRS) -> dict[str, Any]:
    del crs
    route = Route.read(file)
    return {"kind": "lines", "lines": [leg.xy.round(2).tolist() for leg in route.legs]}


_READERS: dict[str, Callable[[Path, CRS], dict[str, Any]]] = {
    "points": _shown_points,
    "checkpoints": _shown_checkpoints,
    "driven": _shown_route,
}


_NODES_ALONG = 150.0
_STANDARD = "asprs-edition-2"


def measured_map(
    area: SurveyArea, points: Path, prior: Path, folder: Path, *, checkpoints: Path | None, progress: Progress
) -> dict[str, Any]:
    """Map measured points over the area, and score the map.

    Returns: the pictures ``elevation`` and ``sigma``, ``sentences`` about the map's error, and the
    ``commands`` that do the same.
    """
    steps = 3 if checkpoints is None else 4
    area.write(folder / "area.gpkg")
    options = _options(area, points, prior, folder)
    progress("mapping the points", 1, steps)
    made = reconstruct(options).write()
    progress("drawing the map", steps - 1, steps)
    sentences, commands = own_claim(made.reconstruction), [_command(options)]
    if checkpoints is not None:
        sentences += _judged(options.out / "dem.tif", checkpoints, folder / "area.gpkg")
        commands.append(_score_command(checkpoints))
    return {
        "sentences": sentences,
        "commands": commands,
        "folder": str(options.out),
        **layers_of(made.reconstruction.mean, made.reconstruction.std),
    }


def _options(area: SurveyArea, points: Path, prior: Path, folder: Path) -> ReconstructRequest:
    xmin, ymin, xmax, ymax = area.bounds
    return ReconstructRequest(
        sources=[points],
        prior=prior,
        step_m=round_number(max(xmax - xmin, ymax - ymin) / _NODES_ALONG),
        area=folder / "area.gpkg",
        crs=area.crs.to_string(),
        sigma_m=SIGMA_M,
        out=folder / "map",
        force=True,
    )


def _judged(map_file: Path, checkpoints: Path, area: Path) -> list[str]:
    """Return in sentences how the map errs at checkpoints, as ``firnline score`` judges it."""
    request = ScoreRequest(source=map_file, checkpoints=checkpoints, area=area, sigma_m=SIGMA_M)
    judged = cast(CheckpointScore, score(request).judged)
    low, high = judged.interval.low_m, judged.interval.high_m
    facts = judged.to_dict()["elevation"]
    first = f"At {facts['n']} checkpoints the map has an RMSE of {facts['rmse_m']:.3f} m ({low:.3f} to {high:.3f} m with 95 %)."
    return [first, *(finding.sentence for finding in judged.assessments)]


def _command(options: ReconstructRequest) -> str:
    words = ["firnline", "reconstruct", options.sources[0].name, "--prior", str(options.prior)]
    words += ["--area", "area.gpkg", "--grid", f"{options.step_m:g}", "--crs", str(options.crs)]
    return shlex.join([*words, "--sigma", f"{options.sigma_m:g}", "-o", "map"])


def _score_command(checkpoints: Path) -> str:
    words = ["firnline", "score", "map/dem.tif", "--checkpoints", checkpoints.name, "--area", "area.gpkg"]
    return shlex.join([*words, "--sigma", f"{SIGMA_M:g}"])


def proposed_swath(
    area: SurveyArea,
    prior: Dem,
    driven: Route,
    points: SurfacePoints,
    *,
    requirement: MapRequirement,
    file: Path,
) -> dict[str, Any]:
    """Propose the swath to drive next, or find that none is needed or none would do.

    Returns: ``sentence``, ``holds``, and the ``lines`` to drive (empty where there are none) with the
    ``file``.
    """
    advice = swath_advice(area, prior, driven, points, requirement)
    limit = f"{requirement.limit_m:.4g} m with {requirement.probability:.0%}"
    found: dict[str, Any] = {"holds": advice.holds, "lines": []}
    if not advice.holds:
        sentence = f"No further swaths would reach {limit}; the densest survey is predicted to err {advice.predicted.rmse_m:.3g} m."
        return {**found, "sentence": sentence}
    if advice.route is None:
        return {**found, "sentence": f"An RMSE within {limit} is met already; no more driving is needed."}
    advice.route.write(file)
    sentence = (
        f"Drive one more swath, {length_text(advice.route.ground_length_m)} with the way there. With those that follow, the map "
        f"is predicted to have an RMSE of {advice.predicted.rmse_m:.2f} m; {limit} is asked for."
    )
    lines = [leg.xy.round(2).tolist() for leg in advice.route.legs]
    return {"holds": True, "lines": lines, "sentence": sentence, "file": file.name}
