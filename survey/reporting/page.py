"""HTML page of a survey: summary, maps, errors, uncertainty, settings and provenance.

`write_report` draws the pictures of a survey, fills the template ``report.html.j2`` and writes ``index.html``
with its figures beside it. The verdict and the calibration are stated in sentences. Tables are rows of text with
units; those of the fleet and of the payload begin with their headings, and are empty without a fleet or a payload.
Equal input gives equal bytes.
"""

import math
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from survey import figures
from survey.core import FloatArray, InputError, write_bytes
from survey.data.route import Route
from survey.data.surface_points import SurfacePoints
from survey.data.trajectory import Trajectory
from survey.figures.calibration import held_out_plot
from survey.figures.maps import probability_plot, quantity_plot, uncertainty_plot
from survey.figures.paths import deviation_from_route, error_over_distance
from survey.reconstruction.terrain_map import Reconstruction
from survey.reporting.quantities import TableRow, named_values, number, percent, setting
from survey.reporting.rendering import (
    PNG,
    Drawing,
    Picture,
    PictureForm,
    animation_of,
    pictures_of,
    render,
)
from survey.reporting.survey_results import (
    FleetResults,
    HazardResults,
    PayloadResults,
    RoverDrive,
    SurveyResults,
)
from survey.scoring import Calibration, Coverage, ErrorStatistics, Score
from survey.scoring.standards.map_classes import Verdict, edition_2_class, edition_2_sentence, own_claim


def write_report(
    folder: str | Path,
    survey: SurveyResults,
    *,
    title: str,
    localization: Mapping[str, float | None] | None = None,
    config_text: str = "",
    provenance: Mapping[str, str] | None = None,
    form: PictureForm = PNG,
    field_work: str = "",
) -> Path:
    """Write ``index.html`` and its figures, in ``figures``, into a folder.

    The page loads nothing: figures are inside it as WebP, and there are no scripts. Links download tables from the
    page itself, and figures from the folder beside it. Equal input gives equal bytes; the page states no date.
    `field_work`: days, person-days and cost, where rates are known.

    Returns: of ``index.html``.
    """
    place = Path(folder)
    if not place.parent.is_dir():
        raise InputError(f"the report folder {place} has no parent folder; create {place.parent} first.")
    pictures = draw_pictures(survey, form)
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
        **_template_values(survey, field_work),
    )
    return _write(place, page, pictures)


def _template_values(survey: SurveyResults, field_work: str) -> dict[str, object]:
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
        "key_numbers": [
            *key_numbers(score, route),
            *([TableRow("Field work", field_work, "by the rates that were named")] if field_work else []),
        ],
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


def draw_pictures(survey: SurveyResults, form: PictureForm = PNG) -> dict[str, Picture]:
    """Draw the pictures of a survey, by their names."""
    pictures = pictures_of(_drawings(survey), form)
    if survey.on_board is not None and survey.on_board.video is not None:
        alt = "Images of the drive, one after the other"
        pictures["video"] = animation_of(
            survey.on_board.video, alt, "Images of the camera, from start to end."
        )
    return pictures


def _drawings(survey: SurveyResults) -> dict[str, Drawing]:
    pictures = _map_pictures(survey) | _error_pictures(survey)
    if survey.reconstruction.check is not None:
        pictures["held_out"] = Drawing(
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
        if survey.on_board.tracks is not None:
            pictures["tracks"] = Drawing(
                survey.on_board.tracks,
                "Images of the drive with tracked corners, before and after CLAHE",
                "Tracked corners: left in the raw images, right after contrast enhancement (CLAHE).",
            )
        if survey.on_board.estimated is not None and survey.reference_trajectory is not None:
            pictures |= _drive_pictures(survey, survey.reference_trajectory, survey.on_board.estimated)
    return pictures


def _fleet_pictures(fleet: FleetResults) -> dict[str, Drawing]:
    """Draw the path of each rover and its error."""
    pictures: dict[str, Drawing] = {}
    for k, rover in enumerate(fleet.rovers, 1):
        drawn = _path_pictures(rover.trajectory, rover.reference_trajectory, None)
        pictures |= {
            f"rover_{k}_{name}": drawn[name]._replace(caption=f"Rover {k}. {drawn[name].caption}")
            for name in _OF_EACH_ROVER
        }
    return pictures


def _payload_pictures(survey: SurveyResults, one: PayloadResults) -> dict[str, Drawing]:
    """Draw the map of a quantity of the payload, and its standard deviation."""
    label, name = one.quantity.label, f"payload_{one.quantity.name}"
    area, route = survey.area, survey.route
    return {
        name: Drawing(
            quantity_plot(one.mapped.mean, label, area=area, route=route),
            f"Map of {label}",
            f"{label}, mapped from readings along the route.",
        ),
        f"{name}_std": Drawing(
            uncertainty_plot(one.mapped.std, label, area=area, route=route),
            f"Map of the standard deviation of {label}",
            f"Standard deviation of {label}.",
        ),
    }


def _hazard_picture(survey: SurveyResults, hazard: HazardResults) -> Drawing:
    """Draw the probability of steep ground."""
    title = f"Slope above {hazard.max_slope_deg:g}°"
    return Drawing(
        probability_plot(hazard.probability, title, area=survey.area, route=survey.route),
        f"Map of the probability of slopes above {hazard.max_slope_deg:g}°",
        f"Probability that the ground is steeper than {hazard.max_slope_deg:g}°, the largest slope of the rover.",
    )


def _map_pictures(survey: SurveyResults) -> dict[str, Drawing]:
    """Draw maps of route, terrain, standard deviation, support and landmarks."""
    area, route, reconstruction = survey.area, survey.route, survey.reconstruction
    pictures = {
        "map": Drawing(
            figures.survey_map(reconstruction.mean, area=area, route=route),
            "Hillshaded map of the site with the route",
            "The reconstructed terrain with the route. Numbers give the order of the swaths.",
        ),
        "terrain": Drawing(
            figures.terrain_comparison(survey.truth, reconstruction, survey.prior, area=area),
            "Reference and reconstruction side by side",
            "Reference, reconstruction and prior in the same colours."
            if survey.prior
            else "Reference and reconstruction in the same colours.",
        ),
        "std": Drawing(
            figures.deviation_map(reconstruction, area=area, route=route),
            "Map of the claimed standard deviation",
            deviation_caption(reconstruction, route),
        ),
        "support": Drawing(
            figures.support_map(reconstruction, area=area, route=route),
            "Map of the support of each node",
            "Support of each height: measured, bounded by a line of sight, interpolated or unseen.",
        ),
    }
    if survey.points is not None:
        pictures["landmarks"] = Drawing(
            figures.landmark_map(
                survey.points, reconstruction.mean, area=area, route=route, name=survey.points_name
            ),
            "Map of the density of landmarks",
            "Density of the measured points.",
        )
    return pictures


# Deviations on the route below this share of the others are called small along it.
_SMALL_SHARE = 0.8


def deviation_caption(reconstruction: Reconstruction, route: Route) -> str:
    """Return the caption of the map of standard deviations; it calls them small along the swaths only where they are."""
    std = reconstruction.std
    paths = [route.sample(std.step_m, rover).xy for rover in range(route.n_rovers)]
    along, everywhere = std.at(np.vstack(paths)), std.elevation
    if np.isfinite(along).any() and np.nanmedian(along) < _SMALL_SHARE * np.nanmedian(everywhere):
        return "Standard deviation of the map: small along the swaths, larger between them."
    return "Standard deviation of the map."


def _error_pictures(survey: SurveyResults) -> dict[str, Drawing]:
    """Draw the errors of the map and their calibration."""
    area, truth, route, reconstruction = survey.area, survey.truth, survey.route, survey.reconstruction
    return {
        "error": Drawing(
            figures.error_map(reconstruction, truth, area=area, route=route),
            "Map of the error",
            "Red: the map lies too high, blue: too low. The limits hold 99% of the errors.",
        ),
        "profile": Drawing(
            figures.terrain_profile(reconstruction, truth, route, prior=survey.prior, area=area),
            "Terrain profiles along one swath and across the survey",
            "Profiles along one swath and across the survey; below, the error inside its claimed band (± 2 σ).",
        ),
        "calibration": Drawing(
            figures.calibration_plot(reconstruction, truth, survey.score.calibration, area=area),
            "Observed against claimed coverage, and errors in claimed standard deviations",
            "On the diagonal (left) and under the curve (right), claim and error agree.",
        ),
        "histogram": Drawing(
            figures.error_histogram(reconstruction, truth, survey.score.elevation, area=area),
            "Histogram of the errors with RMSE, NMAD and 95th percentile",
            "Distribution of the errors.",
        ),
        "distance": Drawing(
            figures.error_against_distance(reconstruction, truth, route, area=area),
            "Error against distance to the route",
            "Error and standard deviation against the distance to the route.",
        ),
    }


def _path_pictures(
    trajectory: Trajectory, reference: Trajectory, points: SurfacePoints | None
) -> dict[str, Drawing]:
    """Draw the estimated path and its error."""
    at_times = np.column_stack(
        [np.interp(trajectory.time_s, reference.time_s, axis) for axis in reference.position.T]
    )
    is_lost = np.asarray(trajectory.health) < 0.5
    return {
        "path": Drawing(
            (
                figures.path_map(
                    trajectory.position,
                    trajectory.covariance,
                    landmarks=None if points is None else points.xyz,
                    landmark_sigma_m=None if points is None else points.sigma_z,
                    reference=reference.position,
                    is_lost=is_lost,
                    crs=trajectory.crs,
                )
            ),
            "Map of the estimated path with its 1σ ellipses, the reference and the landmarks",
            "Estimated path with its 1σ ellipses, the reference, and the landmarks.",
        ),
        "path_error": Drawing(
            error_over_distance(trajectory.position, at_times, trajectory.covariance, is_lost),
            "Horizontal and vertical error of the position over the distance driven, with the claimed band",
            "Error of the position against the distance driven, with the estimated standard deviation.",
        ),
        "trajectory": Drawing(
            figures.error_over_time(trajectory, reference),
            "Error of the estimated position over time with its claimed band",
            "Error of the estimated position: east, north and up. The band is ± 2 estimated σ.",
        ),
    }


def _drive_pictures(survey: SurveyResults, driven: Trajectory, estimated: FloatArray) -> dict[str, Drawing]:
    """Draw the drive beside its plan."""
    route, paths = survey.route, (driven.position, estimated)
    return {
        "executed": Drawing(
            figures.executed_route(route, *paths, area=survey.area),
            "Map of the planned and the driven path",
            "Planned path, driven path, and the path as estimated while driving.",
        ),
        "deviation": Drawing(
            deviation_from_route(route, *paths),
            "Distance from the planned path over the distance driven",
            "True and estimated distance from the route.",
        ),
    }


_STANDARDS = {
    "asprs-1990-as-in-paper": "ASPRS 1990 as read in the glacier paper",
    "asprs-1990-spot-heights": "ASPRS 1990, spot heights",
    "asprs-1990-contours": "ASPRS 1990, contours",
}


def standard_name(standard: str) -> str:
    """Return a standard's name as a reader knows it."""
    return _STANDARDS.get(standard, standard)


def verdict_label(verdict: Verdict) -> str:
    """Return the verdict in one or two words."""
    if verdict.is_withheld:
        return "Withheld"
    return "Met" if verdict.met else "Not met"


def verdict_sentence(verdicts: Sequence[Verdict]) -> str:
    """Say if the first class was met, with the RMSE beside its limit, and which is the tightest one met.

    >>> from survey.scoring.standards.map_classes import judge
    >>> print(*verdict_sentence(judge(0.28)).split())
    The map meets Class 3 of ASPRS 1990 as read in the glacier paper, for a contour interval of 2.743 m: its RMSE is 0.280 m, the limit 0.457 m. The tightest limit that it meets is 0.305 m (Class 2, interval 1.829 m).
    """
    first, met = verdicts[0], [verdict for verdict in verdicts if verdict.met]
    if first.is_withheld:
        return (
            f"No class is stated, because the map does not cover the area: its RMSE on the covered part is "
            f"{number(first.rmse_m, 'm')}, the limit of {first.map_class} of {standard_name(first.standard)} {number(first.limit_m, 'm')}."
        )
    sentence = (
        f"The map {'meets' if first.met else 'does not meet'} {first.map_class} of {standard_name(first.standard)}, "
        f"for a contour interval of {number(first.interval_m, 'm')}: "
        f"its RMSE is {number(first.rmse_m, 'm')}, the limit {number(first.limit_m, 'm')}."
    )
    if not met or met[-1] is first:
        return sentence
    best = met[-1]
    return (
        f"{sentence} The tightest limit that it meets is {number(best.limit_m, 'm')} "
        f"({best.map_class}, interval {number(best.interval_m, 'm')})."
    )


def conditions(score: Score) -> list[str]:
    """Return what the verdict assumes: the standard's condition, and the share of the area that it covers."""
    notes = [] if score.n_silent else [f"{edition_2_sentence(score.elevation.rmse_m, score.covered_share)}."]
    notes += [score.verdicts[0].note] if score.verdicts[0].note else []
    if score.n_silent:
        notes.append(
            f"The map gives a height on {percent(score.covered_share)} of the area; "
            "every error on this page is of that part alone."
        )
    return notes


def calibration_sentence(calibration: Calibration) -> str:
    """Return a sentence on the calibration of the claimed uncertainty.

    Too confident: fewer than 92 % of the errors lie within the claimed 95 % interval. Too
    cautious: more than 98 % do and the errors are smaller than claimed. Between
    the two it is well calibrated, unless rare large errors make their root mean square 1.25 times the
    claim.

    >>> calibration_sentence(Calibration((0.95,), (0.949,), 0.949, 1.02))
    'The claimed uncertainty is well calibrated: 94.9% of the errors lie within the claimed 95% interval, and errors are 1.02 times as large as claimed.'
    """
    share, ratio = calibration.coverage_95, calibration.z_rms
    if math.isnan(share):
        return "The map states no standard deviation, so there is no claim to judge."
    facts = (
        f"{percent(share)} of the errors lie within the claimed 95% interval, "
        f"and errors are {number(ratio, decimals=2)} times as large as claimed"
    )
    if share < 0.92:
        return f"The claimed uncertainty is too small; do not rely on it: {facts}."
    if share > 0.98 and ratio < 1.0:
        return f"The claimed uncertainty is too large, which is safe but wasteful: {facts}."
    if ratio > 1.25:
        return f"The claimed uncertainty is well calibrated except for a few far larger errors: {facts}."
    return f"The claimed uncertainty is well calibrated: {facts}."


def classes_by_standard(score: Score) -> dict[str, list[tuple[Verdict, str, str]]]:
    """Return, for each standard by name, its verdicts with interval and limit as text."""
    tables: dict[str, list[tuple[Verdict, str, str]]] = {}
    for verdict in score.verdicts:
        row = (verdict, number(verdict.interval_m, "m"), number(verdict.limit_m, "m"))
        tables.setdefault(standard_name(verdict.standard), []).append(row)
    return tables


def key_numbers(score: Score, route: Route) -> list[TableRow]:
    """Return the numbers to read first."""
    elevation, verdict = score.elevation, score.verdicts[0]
    return [
        TableRow("RMSE", number(elevation.rmse_m, "m"), f"limit {number(verdict.limit_m, 'm')}"),
        TableRow("NMAD", number(elevation.nmad_m, "m"), "typical error, outliers aside"),
        TableRow(
            "95% of nodes within", number(elevation.p95_m, "m"), f"worst {number(elevation.worst_m, 'm')}"
        ),
        TableRow("95% interval holds", percent(score.calibration.coverage_95), "of the errors; 95% expected"),
        TableRow(
            "Science coverage",
            percent(score.coverage.scc),
            f"{percent(score.coverage.cells_share)} of the cells",
        ),
        TableRow("Route", number(route.ground_length_m / 1000.0, "km", 2), _fleet(route)),
    ]


def _fleet(route: Route) -> str:
    swaths = f"{len(route.swaths)} swath{'s' if len(route.swaths) != 1 else ''}"
    return swaths if route.n_rovers == 1 else f"{swaths}, {route.n_rovers} rovers"


def score_rows(score: Score) -> dict[str, list[TableRow]]:
    """Return the table of scores, grouped, each with a line that explains it."""
    return {
        "Elevation": _elevation_rows(score.elevation),
        "Uncertainty": _calibration_rows(score.calibration),
        "Coverage": _coverage_rows(score.coverage),
        "Nodes of the map": [
            TableRow(
                "Compared",
                number(score.elevation.n, decimals=0),
                "inside the area, with reference and height",
            ),
            TableRow(
                "Silent",
                number(score.n_silent, decimals=0),
                "inside the area, but without a height in the map",
            ),
            TableRow(
                "Unknown", number(score.n_unknown, decimals=0), "inside the area, but without reference"
            ),
            TableRow("Outside", number(score.n_outside, decimals=0), "outside the area, never scored"),
        ],
    }


def _elevation_rows(e: ErrorStatistics) -> list[TableRow]:
    return [
        TableRow("RMSE", number(e.rmse_m, "m"), "root mean square error; what the standards judge"),
        TableRow("Bias", number(e.bias_m, "m"), "mean error; positive: the map lies too high"),
        TableRow(
            "Standard deviation",
            number(e.std_m, "m"),
            f"relative error: what is left after removing the bias; {edition_2_class(e.std_m)}",
        ),
        TableRow("Median", number(e.median_m, "m"), "half of the errors are above, half below"),
        TableRow(
            "NMAD",
            number(e.nmad_m, "m"),
            "spread without regard to outliers; for normal errors the standard deviation",
        ),
        TableRow("95th percentile of |error|", number(e.p95_m, "m"), "95 of 100 nodes err by less"),
        TableRow("Largest |error|", number(e.worst_m, "m"), "the worst node"),
        TableRow("Skewness", number(e.skewness, decimals=2), "0 for symmetric errors"),
        TableRow(
            "Excess kurtosis",
            number(e.kurtosis, decimals=2),
            "0 for normal errors, above 0 for rare large ones",
        ),
    ]


def _calibration_rows(k: Calibration) -> list[TableRow]:
    return [
        TableRow(
            "Errors within the 95% interval",
            percent(k.coverage_95),
            "95% when the standard deviation is right",
        ),
        TableRow(
            "RMS of error over claimed σ",
            number(k.z_rms, decimals=2),
            "1 when the standard deviation is right, above 1 when it is too small",
        ),
    ]


def _coverage_rows(c: Coverage) -> list[TableRow]:
    return [
        TableRow(
            "Science-centric coverage (SCC)",
            percent(c.scc),
            "share of the possible samples, far ones counting more",
        ),
        TableRow("Cells visited", percent(c.cells_share), "plain share of the possible samples"),
        TableRow(
            "Robot-centric coverage",
            number(c.robot_centric),
            "distance driven over that of visiting every cell in lines",
        ),
        TableRow(
            "Centeredness α", number(c.alpha), "0 when the samples are balanced about the centre, 1 at worst"
        ),
        TableRow("Distributedness β", number(c.beta), "0 for straight swaths; – where it is not defined"),
    ]


FLEET_HEADINGS = (
    "Rover", "Swaths", "Distance", "Time", "Energy", "Ending", "Error, horizontal", "Error, vertical",
    "Places shared with others",
)  # fmt: skip
_J_PER_KJ = 1e3


def fleet_rows(fleet: FleetResults | None, route: Route) -> list[list[str]]:
    """Return the heading and one row for each rover; nothing without a fleet."""
    if fleet is None:
        return []
    return [list(FLEET_HEADINGS), *(_fleet_row(k, rover, route) for k, rover in enumerate(fleet.rovers))]


def _fleet_row(k: int, rover: RoverDrive, route: Route) -> list[str]:
    n_swaths = sum(leg.rover == k for leg in route.swaths)
    return [
        f"Rover {k + 1}",
        str(n_swaths),
        number(rover.reference_trajectory.length_m, "m", 0),
        number(rover.duration_s, "s", 0),
        number(rover.energy_j / _J_PER_KJ, "kJ", 0),
        rover.ending,
        number(rover.horizontal_rms_m, "m", 2),
        number(rover.vertical_rms_m, "m", 2),
        str(rover.n_ties),
    ]


PAYLOAD_HEADINGS = (
    "Quantity", "Length scale", "Change per km of elevation", "Noise of a reading", "Claimed σ", "RMSE",
    "95% interval holds", "Science coverage",
)  # fmt: skip


def payload_rows(payload: Sequence[PayloadResults]) -> list[list[str]]:
    """Return the heading and one row for each quantity; nothing without a payload."""
    return [list(PAYLOAD_HEADINGS), *(_payload_row(one) for one in payload)] if payload else []


def _payload_row(one: PayloadResults) -> list[str]:
    found, scores, unit = one.mapped.hyperparameters, one.scores, one.quantity.unit
    change, sigma = (found[f"per_km_of_elevation{name}"] for name in ("", "_sigma"))
    return [
        one.quantity.label,
        number(found["length_scale_m"], "m", 0),
        f"{number(change, decimals=2)} ± {number(sigma, unit, 2)}",
        number(found["noise_sd"], unit),
        number(scores.get("claimed_rms"), unit),
        number(scores.get("rmse"), unit),
        percent(scores.get("coverage_95")),
        percent(scores.get("scc")),
    ]
