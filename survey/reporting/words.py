"""What the numbers of a survey say, in plain words."""

import math
from collections.abc import Mapping
from typing import NamedTuple

from survey.route import Route
from survey.scoring import Calibration, Score, Verdict

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
}
_ACRONYMS = {"ate", "gps", "nees", "nmad", "rmse", "rms", "rpe"}


class Row(NamedTuple):
    """One line of a table: what, how much, and what that means."""

    name: str
    value: str
    meaning: str = ""


def number(value: float | None, unit: str = "", decimals: int = 3) -> str:
    """Write a number with its unit; a dash when there is none.

    Examples
    --------
    >>> number(0.31249, "m"), number(None, "m")
    ('0.312 m', '–')
    """
    if value is None or math.isnan(value):
        return "–"
    return f"{value:,.{decimals}f}".replace(",", "\u202f").replace("-", MINUS) + (f" {unit}" if unit else "")


def percent(share: float | None) -> str:
    """Write a share as a percentage.

    Examples
    --------
    >>> percent(0.9481)
    '94.8%'
    """
    return "–" if share is None or math.isnan(share) else f"{100.0 * share:.1f}%"


def verdict_sentence(verdict: Verdict) -> str:
    """Say if the class was met, with the RMSE beside its limit and the standard by name."""
    outcome = "meets" if verdict.met else "does not meet"
    interval = f" for a contour interval of {number(verdict.interval_m, 'm')}" if verdict.interval_m else ""
    return (
        f"The map {outcome} {verdict.standard}, {verdict.map_class}{interval}: "
        f"its RMSE is {number(verdict.rmse_m, 'm')}, the limit {number(verdict.limit_m, 'm')}."
    )


def calibration_sentence(calibration: Calibration) -> str:
    """Say if the claimed uncertainty is honest.

    Too confident: fewer than 92 % of the errors lie within the claimed 95 % interval. Too
    cautious: more than 98 % do and the errors are smaller than claimed on the whole. Between
    the two it is honest, unless rare large errors make their root mean square 1.25 times the
    claim.

    Examples
    --------
    >>> calibration_sentence(Calibration((0.95,), (0.949,), 0.949, 1.02))
    'The claimed uncertainty is honest: 94.9% of the errors lie within the claimed 95% interval, and errors are 1.02 times as large as claimed.'
    """
    share, ratio = calibration.coverage_95, calibration.z_rms
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


def key_numbers(score: Score, route: Route) -> list[Row]:
    """Return the numbers to read first."""
    elevation, verdict = score.elevation, score.verdicts[0]
    return [
        Row("RMSE", number(elevation.rmse_m, "m"), f"limit {number(verdict.limit_m, 'm')}"),
        Row("NMAD", number(elevation.nmad_m, "m"), "typical error, outliers aside"),
        Row("95% of nodes within", number(elevation.p95_m, "m"), f"worst {number(elevation.worst_m, 'm')}"),
        Row("95% interval holds", percent(score.calibration.coverage_95), "of the errors; 95% is honest"),
        Row(
            "Science coverage",
            percent(score.coverage.scc),
            f"{percent(score.coverage.cells_share)} of the cells",
        ),
        Row("Route", number(route.length_m / 1000.0, "km", 2), _fleet(route)),
    ]


def _fleet(route: Route) -> str:
    swaths = f"{len(route.swaths)} swath{'s' if len(route.swaths) != 1 else ''}"
    return swaths if route.n_rovers == 1 else f"{swaths}, {route.n_rovers} rovers"


def score_rows(score: Score) -> dict[str, list[Row]]:
    """Return the table of scores, grouped, each with a line that explains it."""
    e, c, k = score.elevation, score.coverage, score.calibration
    return {
        "Elevation": [
            Row(
                "Nodes compared",
                f"{e.n:,}".replace(",", "\u202f"),
                "nodes inside the area with known reference",
            ),
            Row("RMSE", number(e.rmse_m, "m"), "root mean square error; what the standards judge"),
            Row("Bias", number(e.bias_m, "m"), "mean error; positive: the map lies too high"),
            Row("Standard deviation", number(e.std_m, "m"), "spread of the errors about the bias"),
            Row("Median", number(e.median_m, "m"), "half of the errors are above, half below"),
            Row(
                "NMAD",
                number(e.nmad_m, "m"),
                "spread that single outliers cannot move; the standard deviation of normal errors",
            ),
            Row("95th percentile of |error|", number(e.p95_m, "m"), "95 of 100 nodes err by less"),
            Row("Largest |error|", number(e.worst_m, "m"), "the worst node"),
            Row("Skewness", number(e.skewness, decimals=2), "0 for errors as often high as low"),
            Row("Kurtosis", number(e.kurtosis, decimals=2), "how heavy the tails are"),
        ],
        "Uncertainty": [
            Row("Errors within the 95% interval", percent(k.coverage_95), "95% when the claim is honest"),
            Row(
                "RMS of error over claimed σ",
                number(k.z_rms, decimals=2),
                "1 when honest, above 1 too confident",
            ),
        ],
        "Coverage": [
            Row("Science coverage (SCC)", percent(c.scc), "distance-weighted share of the possible samples"),
            Row("Cells visited", percent(c.cells_share), "plain share of the possible samples"),
            Row(
                "Robot-centric coverage",
                percent(c.robot_centric),
                "share weighted by distance from where the rover was",
            ),
            Row("Bias of the samples α", number(c.alpha), "0 when the samples are centred in the area"),
            Row("Winding of the swaths β", number(c.beta), "0 for straight swaths; – when it is not defined"),
        ],
    }


def verdict_rows(score: Score) -> list[tuple[Verdict, str, str]]:
    """Return each verdict with its interval and limit as text."""
    return [(v, number(v.interval_m, "m"), number(v.limit_m, "m")) for v in score.verdicts]


def named_values(values: Mapping[str, float]) -> list[Row]:
    """Turn names with unit suffixes into table rows; names that begin with ``n_`` are counts.

    Examples
    --------
    >>> named_values({"drift_rmse_m": 0.25, "n_loops": 3})
    [Row(name='Drift RMSE', value='0.250 m', meaning=''), Row(name='Loops', value='3', meaning='')]
    """
    return [_named_value(key, value) for key, value in values.items()]


def _named_value(key: str, value: float) -> Row:
    if key.startswith("n_"):
        return Row(_label(key.removeprefix("n_")), number(value, decimals=0))
    stem, _, suffix = key.rpartition("_")
    if stem and suffix in _UNITS:
        return Row(_label(stem), number(value, _UNITS[suffix]))
    return Row(_label(key), number(value))


def _label(key: str) -> str:
    words = [word.upper() if word in _ACRONYMS else word for word in key.split("_")]
    text = " ".join(words)
    return text[:1].upper() + text[1:]


def setting(value: object) -> str:
    """Write a hyperparameter: six digits of a float, lists joined by commas."""
    if isinstance(value, list | tuple):
        return ", ".join(setting(item) for item in value)
    return f"{value:.6g}" if isinstance(value, float) else str(value)
