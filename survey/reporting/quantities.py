"""Numbers with their units as text, and rows of tables."""

import math
from collections.abc import Mapping
from typing import NamedTuple

from survey.core.text import duration_text, energy_text

MINUS = "\u2212"

_UNITS = {
    "m": "m", "m2": "m²", "s": "s", "h": "h", "j": "J", "wh": "Wh", "deg": "°", "rad": "rad", "hz": "Hz",
    "percent": "%", "per_cent": "%",
}  # fmt: skip
_MEANINGS = {
    "horizontal_rms_m": "error of the position on the map, over all poses",
    "vertical_rms_m": "error of the height, over all poses", "end_m": "error where the drive ended",
    "end_per_cent": "the same, of the distance travelled", "worst_m": "largest error of any pose",
    "normalised_squared": "squared error over claimed variance; 3 when the standard deviation is right",
}  # fmt: skip
_ACRONYMS = {"ate", "gps", "nmad", "rmse", "rms", "rpe"}


class TableRow(NamedTuple):
    """One line of a table: what, how much, and what that means."""

    name: str
    value: str
    meaning: str = ""


def number(value: float | None, unit: str = "", decimals: int = 3) -> str:
    """Write a number and, behind a space that does not break, its unit; a dash when there is none.

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


def rounded(value: float) -> str:
    """Write a large number with four significant digits and thin spaces between thousands.

    Examples
    --------
    >>> rounded(2886754.3).split("\u202f"), rounded(-0.01234)
    (['2', '887', '000'], '-0.01234')
    """
    digits = float(f"{value:.4g}")
    return (
        f"{digits:,.0f}".replace(",", "\u202f").replace("-", MINUS) if abs(digits) >= 1000 else f"{digits:g}"
    )


def percent(share: float | None) -> str:
    """Write a share as a percentage.

    >>> percent(0.9481)
    '94.8%'
    """
    return "–" if share is None or math.isnan(share) else f"{100.0 * share:.1f}%"


# Time and energy of a drive, and shares, in the units that people read.
_READ_BY_PEOPLE = {"_s": duration_text, "_j": energy_text, "_share": percent}


def named_values(values: Mapping[str, float | None]) -> list[TableRow]:
    """Turn names with unit suffixes into table rows; names that begin with ``n_`` are counts.

    >>> [(row.name, row.value.split()) for row in named_values({"drift_rmse_m": 0.25, "n_loops": 3})]
    [('Drift RMSE', ['0.250', 'm']), ('Loops', ['3'])]
    >>> [(row.name, row.value) for row in named_values({"time_s": 8100.0, "left_out_share": 0.02})]
    [('Time', '2 h 15 min'), ('Left out', '2.0%')]
    """
    return [_named_value(key, value) for key, value in values.items()]


def _named_value(key: str, value: float | None) -> TableRow:
    meaning = _MEANINGS.get(key, "")
    if key.startswith("n_"):
        return TableRow(_label(key.removeprefix("n_")), number(value, decimals=0), meaning)
    if value is not None and math.isfinite(value):
        for suffix, text in _READ_BY_PEOPLE.items():
            stem = key.removesuffix(suffix)
            if stem != key:
                return TableRow(_label(stem), text(value), meaning)
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
