"""One offline HTML page that shows a survey, its map, and how far both can be trusted."""

import base64
import struct
from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

import numpy as np
from jinja2 import Environment, PackageLoader, StrictUndefined
from matplotlib.figure import Figure

from survey import figures
from survey.area import SurveyArea
from survey.arrays import FloatArray
from survey.dem import Dem
from survey.errors import InputError
from survey.io.files import replacing
from survey.reconstruction.base import Reconstruction
from survey.reporting import words
from survey.route import Route
from survey.scoring import Score
from survey.surface_points import SurfacePoints
from survey.trajectory import Trajectory


class Picture(NamedTuple):
    """A figure as the page shows it: PNG (or animated WebP) bytes, words for those who cannot see it, a caption."""

    png: bytes
    alt: str
    caption: str

    @property
    def kind(self) -> str:
        """Its format, by its first bytes."""
        return "webp" if self.png.startswith(b"RIFF") else "png"

    @property
    def source(self) -> str:
        """The image itself as a data URI."""
        return f"data:image/{self.kind};base64," + base64.b64encode(self.png).decode("ascii")

    @property
    def size(self) -> tuple[int, int]:
        """Width and height in pixels, from the header."""
        if (
            self.kind == "webp"
        ):  # canvas less one, in 24 bits each, of the extended format that animations have
            width, height = (int.from_bytes(self.png[at : at + 3], "little") + 1 for at in (24, 27))
            return width, height
        width, height = struct.unpack(">II", self.png[16:24])
        return int(width), int(height)


class _Survey(NamedTuple):
    """What the figures are drawn from."""

    area: SurveyArea
    prior: Dem | None
    truth: Dem
    route: Route
    reconstruction: Reconstruction
    score: Score
    points: SurfacePoints | None


def write_report(
    folder: str | Path,
    *,
    title: str,
    area: SurveyArea,
    prior: Dem | None,
    truth: Dem,
    route: Route,
    reconstruction: Reconstruction,
    score: Score,
    trajectory: Trajectory | None = None,
    reference_trajectory: Trajectory | None = None,
    points: SurfacePoints | None = None,
    localization: Mapping[str, float | None] | None = None,
    tracks: Figure | None = None,
    believed: FloatArray | None = None,
    video: bytes | None = None,
    config_text: str = "",
    provenance: Mapping[str, str] | None = None,
) -> Path:
    """Write ``index.html`` and ``figures/*.png`` into a folder.

    The page loads nothing: figures are inside it, there are no scripts and no links to
    other files. Equal input gives equal bytes, for it states no date of its own.

    Parameters
    ----------
    folder : str or pathlib.Path
        Made when it does not exist; its parent must.
    title : str
        Heading of the page.
    area : SurveyArea
        What was to be mapped; errors are shown inside it only.
    prior : Dem or None
        What was known before.
    truth : Dem
        The reference terrain.
    route : Route
        What was driven, or planned.
    reconstruction : Reconstruction
        The survey's map.
    score : Score
        How good it is; its first verdict is the headline.
    trajectory, reference_trajectory : Trajectory, optional
        Where the rover believed to be and where it was; drawn when both are given.
    points : SurfacePoints, optional
        What the map was made from.
    localization : mapping of str to float or None, optional
        Results of the localization, units in the names.
    tracks : matplotlib.figure.Figure, optional
        What the camera followed, where there was one.
    believed : (N, 2) ndarray, optional
        Where the rover thought that it was while it steered by that [m]: the drive is shown
        beside its plan.
    video : bytes, optional
        What the camera saw, as an animated WebP.
    config_text : str
        The resolved configuration, shown as it is.
    provenance : mapping of str to str, optional
        Versions, seed, checksums, in the order to show them.

    Returns
    -------
    pathlib.Path
        Of ``index.html``.

    Raises
    ------
    InputError
        When the folder cannot be written to, or the inputs are in different CRS.
    """
    place = Path(folder)
    if not place.parent.is_dir():
        raise InputError(f"the report folder {place} has no parent folder; create {place.parent} first.")
    survey = _Survey(area, prior, truth, route, reconstruction, score, points)
    pictures = _map_pictures(survey) | _error_pictures(survey)
    if trajectory is not None and reference_trajectory is not None:
        pictures |= _path_pictures(trajectory, reference_trajectory, points)
    if believed is not None and reference_trajectory is not None:
        pictures |= _drive_pictures(survey, reference_trajectory, believed)
    if video is not None:
        pictures["video"] = Picture(
            video, "Images of the drive, one after the other", "What the camera saw, from start to end."
        )
    if tracks is not None:
        pictures["tracks"] = Picture(
            _png(tracks),
            "Images of the drive with the corners that were followed, before and after CLAHE",
            "What the camera followed: lines are the ways of corners, left in the images as they came, right after their contrast was raised.",
        )
    page = _render(
        title=title,
        pictures=pictures,
        is_met=score.verdicts[0].met,
        verdict_sentence=words.verdict_sentence(score.verdicts),
        conditions=words.conditions(score),
        classes=words.classes_by_standard(score),
        key_numbers=words.key_numbers(score, route),
        calibration_sentence=words.calibration_sentence(score.calibration),
        scores=words.score_rows(score),
        localization=words.named_values(localization or {}),
        prediction=words.named_values(route.prediction),
        method=reconstruction.method,
        hyperparameters={name: words.setting(v) for name, v in reconstruction.hyperparameters.items()},
        crs=f"{reconstruction.mean.crs.name}, heights above {reconstruction.mean.vertical_datum or 'an unstated datum'}",
        config_text=config_text,
        provenance=dict(provenance or {}),
    )
    return _write(place, page, pictures)


def _map_pictures(survey: _Survey) -> dict[str, Picture]:
    """Draw what was driven, what came out, and what it rests on."""
    area, route, reconstruction = survey.area, survey.route, survey.reconstruction
    pictures = {
        "map": Picture(
            _png(figures.route_map(reconstruction.mean, area=area, route=route)),
            "Hillshaded map of the site with the route",
            "The reconstructed terrain with the route. Numbers give the order of the swaths.",
        ),
        "terrain": Picture(
            _png(figures.terrain_comparison(survey.truth, reconstruction, survey.prior, area=area)),
            "Reference and reconstruction side by side",
            "The ground as it is, as it was mapped, and as it was known before; all in the same colours."
            if survey.prior
            else "The ground as it is and as it was mapped, in the same colours.",
        ),
        "std": Picture(
            _png(figures.deviation_map(reconstruction, area=area, route=route)),
            "Map of the claimed standard deviation",
            "What the map claims to know: small along the swaths, larger between them.",
        ),
        "support": Picture(
            _png(figures.support_map(reconstruction, area=area, route=route)),
            "Map of what each node rests on",
            "What stands behind each height.",
        ),
    }
    if survey.points is not None:
        pictures["landmarks"] = Picture(
            _png(figures.landmark_map(survey.points, reconstruction.mean, area=area, route=route)),
            "Map of the density of landmarks",
            "Where the surface was measured, and how densely.",
        )
    return pictures


def _error_pictures(survey: _Survey) -> dict[str, Picture]:
    """Draw how far the map is from the reference, and if it knows so."""
    area, truth, route, reconstruction = survey.area, survey.truth, survey.route, survey.reconstruction
    return {
        "error": Picture(
            _png(figures.error_map(reconstruction, truth, area=area, route=route)),
            "Map of the error",
            "Red: the map lies too high, blue: too low. The limits hold 99% of the errors.",
        ),
        "profile": Picture(
            _png(figures.terrain_profile(reconstruction, truth, route, prior=survey.prior, area=area)),
            "Terrain profiles along one swath and across the survey",
            "Profiles along one swath and across the survey; below, the error inside its claimed band (± 2 σ).",
        ),
        "calibration": Picture(
            _png(figures.calibration_plot(reconstruction, truth, survey.score.calibration, area=area)),
            "Observed against claimed coverage, and errors in claimed standard deviations",
            "On the diagonal (left) and under the curve (right), claim and error agree.",
        ),
        "histogram": Picture(
            _png(figures.error_histogram(reconstruction, truth, survey.score.elevation, area=area)),
            "Histogram of the errors with RMSE, NMAD and 95th percentile",
            "How the errors are distributed.",
        ),
        "distance": Picture(
            _png(figures.error_against_distance(reconstruction, truth, route, area=area)),
            "Error against distance to the route",
            "How error and claim grow away from the route.",
        ),
    }


def _path_pictures(
    trajectory: Trajectory, reference: Trajectory, points: SurfacePoints | None
) -> dict[str, Picture]:
    """Draw where the rover believed to be, and how far off it was."""
    at_times = np.column_stack(
        [np.interp(trajectory.time_s, reference.time_s, axis) for axis in reference.position.T]
    )
    is_lost = np.asarray(trajectory.health) < 0.5
    return {
        "path": Picture(
            _png(
                figures.path_map(
                    trajectory.position,
                    trajectory.covariance,
                    landmarks=None if points is None else points.xyz,
                    landmark_sigma_m=None if points is None else points.sigma_z,
                    reference=reference.position,
                    is_lost=is_lost,
                )
            ),
            "Map of the estimated path with its 1σ ellipses, the reference and the landmarks",
            "Where the rover believed to be, how surely, and what it saw from there.",
        ),
        "path_error": Picture(
            _png(figures.error_over_distance(trajectory.position, at_times, trajectory.covariance, is_lost)),
            "Horizontal and vertical error of the position over the distance driven, with the claimed band",
            "How the error of the position grows with the distance, and what was claimed of it.",
        ),
        "trajectory": Picture(
            _png(figures.trajectory_error(trajectory, reference)),
            "Error of the estimated position over time with its claimed band",
            "Error of the estimated position: east, north and up. The band is what the rover claims (± 2 σ).",
        ),
    }


def _drive_pictures(survey: _Survey, driven: Trajectory, believed: FloatArray) -> dict[str, Picture]:
    """Draw how the drive kept to its plan."""
    route, paths = survey.route, (driven.position, believed)
    return {
        "executed": Picture(
            _png(figures.executed_route(route, *paths, area=survey.area)),
            "Map of the planned path and of the one that was driven",
            "Where the rover was to go, where it went, and where it thought that it was.",
        ),
        "deviation": Picture(
            _png(figures.deviation_from_route(route, *paths)),
            "Distance from the planned path over the distance driven",
            "How far from its route the rover was, and how far it thought that it was.",
        ),
    }


def _png(figure: Figure) -> bytes:
    return figures.png_bytes(figure)


def _render(**content: object) -> str:
    environment = Environment(
        loader=PackageLoader("survey.reporting", "templates"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )
    return environment.get_template("report.html.j2").render(**content)


def _write(folder: Path, page: str, pictures: Mapping[str, Picture]) -> Path:
    """Write the pictures, then the page that stands for the whole."""
    try:
        folder.mkdir(exist_ok=True)
        (folder / "figures").mkdir(exist_ok=True)
    except OSError as error:
        raise InputError(
            f"the report folder {folder} could not be made ({error.strerror or error}); choose another place."
        ) from error
    for name, picture in pictures.items():
        with replacing(folder / "figures" / f"{name}.{picture.kind}") as draft:
            draft.write_bytes(picture.png)
    with replacing(folder / "index.html") as draft:
        draft.write_bytes(page.encode("utf-8"))
    return folder / "index.html"
