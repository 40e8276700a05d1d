"""Summary of a survey: sentences, key numbers, and tables of the score, the rovers and the payload.

The verdict and the calibration are stated in sentences. Tables are rows of text with units; those of the fleet
and of the payload begin with their headings, and are empty without a fleet or a payload.
"""

import math
from collections.abc import Sequence

from survey.data.route import Route
from survey.reporting.quantities import TableRow, number, percent
from survey.reporting.survey_results import FleetResults, PayloadResults, RoverDrive
from survey.scoring import Calibration, Coverage, ErrorStatistics, Score, Verdict, judge

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

    Examples
    --------
    >>> from survey.scoring import judge
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
    notes = [score.verdicts[0].note] if score.verdicts[0].note else []
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

    Examples
    --------
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
            f"relative error: what is left after removing the bias; {_relative_class(e)}",
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


def _relative_class(e: ErrorStatistics) -> str:
    """Return the tightest class that the error without the bias meets, as text."""
    met = [verdict for verdict in judge(e.std_m) if verdict.met]
    return f"{met[-1].map_class} (limit {number(met[-1].limit_m, 'm')})" if met else "no class"


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
    "Quantity",
    "Length scale",
    "Change per km of elevation",
    "Noise of a reading",
    "Claimed σ",
    "RMSE",
    "95% interval holds",
    "Science coverage",
)


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
