"""Summary sentences and key numbers of a survey."""

import math
from collections.abc import Sequence

from survey.data.route import Route
from survey.reporting.quantities import TableRow, number, percent
from survey.scoring import Calibration, Score, Verdict

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
