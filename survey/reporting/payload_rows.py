"""Table of the quantities of a science payload: length scale, dependence on elevation, noise, and scores."""

from collections.abc import Sequence

from survey.reporting.quantities import number, percent
from survey.reporting.surveyed import PayloadResults

HEADINGS = (
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
    return [list(HEADINGS), *(_row(one) for one in payload)] if payload else []


def _row(one: PayloadResults) -> list[str]:
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
