"""Summary sentences and tables of the numbers of a survey."""

import math
from collections.abc import Mapping, Sequence
from typing import NamedTuple

from survey.data.route import Route
from survey.scoring import Calibration, Coverage, ErrorStatistics, Score, Verdict

MINUS = "\u2212"

_UNITS = {
    "m": "m",
    "m2": "m²",
    "s": "s",
    "h": "h",
    "j": "J",
    "wh": "Wh",
    "deg": "°",
    "rad": "rad",
    "hz": "Hz",
    "percent": "%",
    "per_cent": "%",
}
_STANDARDS = {
    "asprs-1990-as-in-paper": "ASPRS 1990 as read in the glacier paper",
    "asprs-1990-spot-heights": "ASPRS 1990, spot heights",
    "asprs-1990-contours": "ASPRS 1990, contours",
}
_MEANINGS = {
    "horizontal_rms_m": "error of the position on the map, over all poses",
    "vertical_rms_m": "error of the height, over all poses",
    "end_m": "error where the drive ended",
    "end_per_cent": "the same, of the distance travelled",
    "worst_m": "largest error of any pose",
    "normalised_squared": "squared error over claimed variance; 3 when the claim is honest",
}
_ACRONYMS = {"ate", "gps", "nmad", "rmse", "rms", "rpe"}


class TableRow(NamedTuple):
    """One line of a table: what, how much, and what that means."""

    name: str
    value: str
    meaning: str = ""


def number(value: float | None, unit: str = "", decimals: int = 3) -> str:
    """Write a number and, behind a space that does not break, its unit; a dash when there is none.

    Examples
    --------
    >>> number(0.31249, "m").split(), number(None, "m")
    (['0.312', 'm'], '–')
    """
    if value is None or math.isnan(value):
        return "–"
    if math.isinf(value):
        return "∞"
    return f"{value:,.{decimals}f}".replace(",", "\u202f").replace("-", MINUS) + (
        f"\u00a0{unit}" if unit else ""
    )


def percent(share: float | None) -> str:
    """Write a share as a percentage.

    Examples
    --------
    >>> percent(0.9481)
    '94.8%'
    """
    return "–" if share is None or math.isnan(share) else f"{100.0 * share:.1f}%"


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
    """Return what the verdict assumes: the standard's condition, and how much of the area it speaks of."""
    notes = [score.verdicts[0].note] if score.verdicts[0].note else []
    if score.n_silent:
        notes.append(
            f"The map gives a height on {percent(score.covered_share)} of the area; "
            "every error on this page is of that part alone."
        )
    return notes


def calibration_sentence(calibration: Calibration) -> str:
    """Say if the claimed uncertainty is honest.

    Too confident: fewer than 92 % of the errors lie within the claimed 95 % interval. Too
    cautious: more than 98 % do and the errors are smaller than claimed. Between
    the two it is honest, unless rare large errors make their root mean square 1.25 times the
    claim.

    Examples
    --------
    >>> calibration_sentence(Calibration((0.95,), (0.949,), 0.949, 1.02))
    'The claimed uncertainty is honest: 94.9% of the errors lie within the claimed 95% interval, and errors are 1.02 times as large as claimed.'
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
        return f"The claimed uncertainty is honest for most of the map, but a few errors are far larger: {facts}."
    return f"The claimed uncertainty is honest: {facts}."


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
        TableRow(
            "95% interval holds", percent(score.calibration.coverage_95), "of the errors; 95% is honest"
        ),
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
        TableRow("Standard deviation", number(e.std_m, "m"), "spread of the errors about the bias"),
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
        TableRow("Errors within the 95% interval", percent(k.coverage_95), "95% when the claim is honest"),
        TableRow(
            "RMS of error over claimed σ", number(k.z_rms, decimals=2), "1 when honest, above 1 too confident"
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


def named_values(values: Mapping[str, float | None]) -> list[TableRow]:
    """Turn names with unit suffixes into table rows; names that begin with ``n_`` are counts.

    Examples
    --------
    >>> [(row.name, *row.value.split()) for row in named_values({"drift_rmse_m": 0.25, "n_loops": 3})]
    [('Drift RMSE', '0.250', 'm'), ('Loops', '3')]
    """
    return [_named_value(key, value) for key, value in values.items()]


def _named_value(key: str, value: float | None) -> TableRow:
    meaning = _MEANINGS.get(key, "")
    if key.startswith("n_"):
        return TableRow(_label(key.removeprefix("n_")), number(value, decimals=0), meaning)
    decimals = 3 if value is None or abs(value) < 100.0 else 0
    for suffix, unit in _UNITS.items():
        stem = key.removesuffix(f"_{suffix}")
        if stem != key:
            return TableRow(_label(stem), number(value, unit, decimals), meaning)
    return TableRow(_label(key), number(value, decimals=decimals), meaning)


def _label(key: str) -> str:
    words = [word.upper() if word in _ACRONYMS else word for word in key.split("_")]
    text = " ".join(words)
    return text[:1].upper() + text[1:]


def setting(value: object) -> str:
    """Write a hyperparameter: six digits of a float, lists joined by commas."""
    if isinstance(value, list | tuple):
        return ", ".join(setting(item) for item in value)
    return f"{value:.6g}" if isinstance(value, float) else str(value)
