"""HTML page of a survey: maps, errors, uncertainty, settings and provenance.

`write_report` draws the pictures of a survey, fills the template ``report.html.j2`` and writes ``index.html``
with its figures beside it. Sentences and tables come from `survey.reporting.summary`. Equal input gives equal
bytes.
"""

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from survey import figures
from survey.core import FloatArray, InputError, write_bytes
from survey.data.surface_points import SurfacePoints
from survey.data.trajectory import Trajectory
from survey.figures.calibration import held_out_plot
from survey.figures.maps import probability_plot, quantity_plot, uncertainty_plot
from survey.figures.paths import deviation_from_route, error_over_distance
from survey.reporting.quantities import named_values, setting
from survey.reporting.rendering import Picture, animation_of, picture_of, render
from survey.reporting.summary import (
    calibration_sentence,
    classes_by_standard,
    conditions,
    fleet_rows,
    key_numbers,
    payload_rows,
    score_rows,
    verdict_label,
    verdict_sentence,
)
from survey.reporting.survey_results import (
    FleetResults,
    HazardResults,
    OnBoard,
    PayloadResults,
    SurveyResults,
)
from survey.scoring import Score
from survey.scoring.standards.map_classes import own_claim


def write_report(
    folder: str | Path,
    survey: SurveyResults,
    *,
    title: str,
    localization: Mapping[str, float | None] | None = None,
    config_text: str = "",
    provenance: Mapping[str, str] | None = None,
) -> Path:
    """Write ``index.html`` and ``figures/*.png`` into a folder.

    The page loads nothing: figures are inside it as WebP, and there are no scripts. Links download tables from the
    page itself, and figures from the folder beside it. Equal input gives equal bytes; the page states no date.

    Returns: of ``index.html``.
    """
    place = Path(folder)
    if not place.parent.is_dir():
        raise InputError(f"the report folder {place} has no parent folder; create {place.parent} first.")
    pictures = draw_pictures(survey)
    page = render(
        "report.html.j2",
        title=title,
        pictures=pictures,
        localization=named_values(localization or {}),
        fleet=fleet_rows(survey.fleet, survey.route),
        hazard=named_values({} if survey.hazard is None else survey.hazard.facts),
        payload=payload_rows(survey.payload),
        losses=named_values({} if survey.fleet is None else survey.fleet.losses),
        config_text=config_text,
        provenance=dict(provenance or {}),
        **_template_values(survey),
    )
    return _write(place, page, pictures)


def _template_values(survey: SurveyResults) -> dict[str, object]:
    """Return the content about map and score, by the names of the template."""
    score, route, reconstruction = survey.score, survey.route, survey.reconstruction
    datum = reconstruction.mean.vertical_datum or "an unstated datum"
    return {
        "is_met": score.verdicts[0].met,
        "verdict_label": verdict_label(score.verdicts[0]),
        "verdict_sentence": verdict_sentence(score.verdicts),
        "conditions": conditions(score),
        "classes": classes_by_standard(score),
        "classes_as_rows": _class_rows(score),
        "key_numbers": key_numbers(score, route),
        "calibration_sentence": calibration_sentence(score.calibration),
        "own_claim": [sentence[0].upper() + sentence[1:] for sentence in own_claim(reconstruction)],
        "scores": score_rows(score),
        "prediction": named_values(route.prediction),
        "method": reconstruction.method,
        "hyperparameters": {name: setting(v) for name, v in reconstruction.hyperparameters.items()},
        "crs": f"{reconstruction.mean.crs.name}, heights above {datum}",
    }


def _class_rows(score: Score) -> dict[str, list[list[str]]]:
    """Return the rows of each table of classes as text, for its download."""
    return {
        standard: [
            ["class", "contour interval", "limit of the RMSE", "verdict"],
            *([v.map_class, interval, limit, "met" if v.met else "not met"] for v, interval, limit in rows),
        ]
        for standard, rows in classes_by_standard(score).items()
    }


def _write(folder: Path, page: str, pictures: Mapping[str, Picture]) -> Path:
    """Write the pictures, then the page."""
    try:
        folder.mkdir(exist_ok=True)
        (folder / "figures").mkdir(exist_ok=True)
    except OSError as error:
        raise InputError(
            f"the report folder {folder} could not be made ({error.strerror or error}); choose another place."
        ) from error
    for name, picture in pictures.items():
        write_bytes(folder / "figures" / f"{name}.{picture.kind}", picture.image)
    write_bytes(folder / "index.html", page.encode("utf-8"))
    return folder / "index.html"


_OF_EACH_ROVER = ("path", "path_error")


def draw_pictures(survey: SurveyResults) -> dict[str, Picture]:
    """Draw the pictures of a survey, by their names."""
    pictures = _map_pictures(survey) | _error_pictures(survey)
    if survey.reconstruction.check is not None:
        pictures["held_out"] = picture_of(
            held_out_plot(survey.reconstruction.check),
            "Quantiles of points that were left out, and the factor on the standard deviation",
            "Points that were left out, in tenths of their predictive distribution (10 % each when the standard "
            "deviation is right), and the factor by which it is widened.",
        )
    if survey.trajectory is not None and survey.reference_trajectory is not None:
        pictures |= _path_pictures(survey.trajectory, survey.reference_trajectory, survey.points)
    if survey.fleet is not None:
        pictures |= _fleet_pictures(survey.fleet)
    for one in survey.payload:
        pictures |= _payload_pictures(survey, one)
    if survey.hazard is not None:
        pictures["hazard"] = _hazard_picture(survey, survey.hazard)
    if survey.on_board is not None:
        pictures |= _camera_pictures(survey.on_board)
        if survey.on_board.estimated is not None and survey.reference_trajectory is not None:
            pictures |= _drive_pictures(survey, survey.reference_trajectory, survey.on_board.estimated)
    return pictures


def _fleet_pictures(fleet: FleetResults) -> dict[str, Picture]:
    """Draw the path of each rover and its error."""
    pictures: dict[str, Picture] = {}
    for k, rover in enumerate(fleet.rovers, 1):
        drawn = _path_pictures(rover.trajectory, rover.reference_trajectory, None)
        pictures |= {
            f"rover_{k}_{name}": drawn[name]._replace(caption=f"Rover {k}. {drawn[name].caption}")
            for name in _OF_EACH_ROVER
        }
    return pictures


def _payload_pictures(survey: SurveyResults, one: PayloadResults) -> dict[str, Picture]:
    """Draw the map of a quantity of the payload, and its standard deviation."""
    label, name = one.quantity.label, f"payload_{one.quantity.name}"
    area, route = survey.area, survey.route
    return {
        name: picture_of(
            quantity_plot(one.mapped.mean, label, area=area, route=route),
            f"Map of {label}",
            f"{label}, mapped from readings along the route.",
        ),
        f"{name}_std": picture_of(
            uncertainty_plot(one.mapped.std, label, area=area, route=route),
            f"Map of the standard deviation of {label}",
            f"Standard deviation of {label}.",
        ),
    }


def _hazard_picture(survey: SurveyResults, hazard: HazardResults) -> Picture:
    """Draw the probability of steep ground."""
    title = f"Slope above {hazard.max_slope_deg:g}°"
    return picture_of(
        probability_plot(hazard.probability, title, area=survey.area, route=survey.route),
        f"Map of the probability of slopes above {hazard.max_slope_deg:g}°",
        f"Probability that the ground is steeper than {hazard.max_slope_deg:g}°, the largest slope of the rover.",
    )


def _map_pictures(survey: SurveyResults) -> dict[str, Picture]:
    """Draw maps of route, terrain, standard deviation, support and landmarks."""
    area, route, reconstruction = survey.area, survey.route, survey.reconstruction
    pictures = {
        "map": picture_of(
            figures.survey_map(reconstruction.mean, area=area, route=route),
            "Hillshaded map of the site with the route",
            "The reconstructed terrain with the route. Numbers give the order of the swaths.",
        ),
        "terrain": picture_of(
            figures.terrain_comparison(survey.truth, reconstruction, survey.prior, area=area),
            "Reference and reconstruction side by side",
            "Reference, reconstruction and prior in the same colours."
            if survey.prior
            else "Reference and reconstruction in the same colours.",
        ),
        "std": picture_of(
            figures.deviation_map(reconstruction, area=area, route=route),
            "Map of the claimed standard deviation",
            "Standard deviation of the map: small along the swaths, larger between them.",
        ),
        "support": picture_of(
            figures.support_map(reconstruction, area=area, route=route),
            "Map of the support of each node",
            "Support of each height: measured, bounded by a line of sight, interpolated or unseen.",
        ),
    }
    if survey.points is not None:
        pictures["landmarks"] = picture_of(
            figures.landmark_map(
                survey.points, reconstruction.mean, area=area, route=route, name=survey.points_name
            ),
            "Map of the density of landmarks",
            "Density of the measured points.",
        )
    return pictures


def _error_pictures(survey: SurveyResults) -> dict[str, Picture]:
    """Draw the errors of the map and their calibration."""
    area, truth, route, reconstruction = survey.area, survey.truth, survey.route, survey.reconstruction
    return {
        "error": picture_of(
            figures.error_map(reconstruction, truth, area=area, route=route),
            "Map of the error",
            "Red: the map lies too high, blue: too low. The limits hold 99% of the errors.",
        ),
        "profile": picture_of(
            figures.terrain_profile(reconstruction, truth, route, prior=survey.prior, area=area),
            "Terrain profiles along one swath and across the survey",
            "Profiles along one swath and across the survey; below, the error inside its claimed band (± 2 σ).",
        ),
        "calibration": picture_of(
            figures.calibration_plot(reconstruction, truth, survey.score.calibration, area=area),
            "Observed against claimed coverage, and errors in claimed standard deviations",
            "On the diagonal (left) and under the curve (right), claim and error agree.",
        ),
        "histogram": picture_of(
            figures.error_histogram(reconstruction, truth, survey.score.elevation, area=area),
            "Histogram of the errors with RMSE, NMAD and 95th percentile",
            "Distribution of the errors.",
        ),
        "distance": picture_of(
            figures.error_against_distance(reconstruction, truth, route, area=area),
            "Error against distance to the route",
            "Error and standard deviation against the distance to the route.",
        ),
    }


def _path_pictures(
    trajectory: Trajectory, reference: Trajectory, points: SurfacePoints | None
) -> dict[str, Picture]:
    """Draw the estimated path and its error."""
    at_times = np.column_stack(
        [np.interp(trajectory.time_s, reference.time_s, axis) for axis in reference.position.T]
    )
    is_lost = np.asarray(trajectory.health) < 0.5
    return {
        "path": picture_of(
            (
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
            "Estimated path with its 1σ ellipses, the reference, and the landmarks.",
        ),
        "path_error": picture_of(
            error_over_distance(trajectory.position, at_times, trajectory.covariance, is_lost),
            "Horizontal and vertical error of the position over the distance driven, with the claimed band",
            "Error of the position against the distance driven, with the estimated standard deviation.",
        ),
        "trajectory": picture_of(
            figures.error_over_time(trajectory, reference),
            "Error of the estimated position over time with its claimed band",
            "Error of the estimated position: east, north and up. The band is ± 2 estimated σ.",
        ),
    }


def _drive_pictures(survey: SurveyResults, driven: Trajectory, estimated: FloatArray) -> dict[str, Picture]:
    """Draw the drive beside its plan."""
    route, paths = survey.route, (driven.position, estimated)
    return {
        "executed": picture_of(
            figures.executed_route(route, *paths, area=survey.area),
            "Map of the planned and the driven path",
            "Planned path, driven path, and the path as estimated while driving.",
        ),
        "deviation": picture_of(
            deviation_from_route(route, *paths),
            "Distance from the planned path over the distance driven",
            "True and estimated distance from the route.",
        ),
    }


def _camera_pictures(on_board: OnBoard) -> dict[str, Picture]:
    """Return the pictures of the camera: video and feature tracks."""
    pictures = {}
    if on_board.video is not None:
        alt = "Images of the drive, one after the other"
        pictures["video"] = animation_of(on_board.video, alt, "Images of the camera, from start to end.")
    if on_board.tracks is not None:
        pictures["tracks"] = picture_of(
            (on_board.tracks),
            "Images of the drive with tracked corners, before and after CLAHE",
            "Tracked corners: left in the raw images, right after contrast enhancement (CLAHE).",
        )
    return pictures
