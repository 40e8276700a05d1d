"""Lines of facts for people: a name, and a value with its unit, alike in all commands."""

import re
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any, NoReturn

import typer

_WIDTH = 18
_DRY_RUN = "nothing was written (--dry-run)"
_NAMES = {
    "n": "points",
    "std": "standard deviation",
    "worst": "largest error",
    "horizontal rms": "horizontal RMS error",
    "vertical rms": "vertical RMS error",
    "end sigma": "σ at the end",
    "yaw rms": "heading RMS error",
    "ate se3": "RMS, aligned",
    "ate sim3": "RMS, scaled",
}
_WORDS = {"rmse": "RMSE", "nmad": "NMAD", "p95": "95 % below", "rpe": "relative error", "nees": "NEES"}
_UNITS = {
    "m": "{:.3f} m",
    "m2": "{:.4g} m²",
    "deg": "{:.2f}°",
    "per_cent": "{:.2f} %",
}
# A unit ends a name, or stands before the number of one of several.
_UNIT = re.compile(r"_(m2|m|s|deg|per_cent)(?=(_\d+)?$)")


def fact_line(name: str, value: object) -> str:
    """Return one fact: its name, padded to the width of the column, and its value.

    >>> fact_line("length", "4.09 km")
    '  length             4.09 km'
    """
    return f"  {name:<{_WIDTH}} {value}"


def figure_lines(figures: Mapping[str, Any]) -> list[str]:
    r"""Return figures with machine names, such as ``rmse_m``, as facts with units.

    >>> print("\n".join(figure_lines({"rmse_m": 0.04661, "length_m": 4093.2, "time_s": 4140.0, "n": 36})))
      RMSE               0.047 m
      length             4.09 km
      time               1 h 09 min
      points             36
    """
    return [fact_line(_title(name), _value(name, value)) for name, value in figures.items()]


def end_dry_run(writes: Iterable[Path], facts: Mapping[str, object] | None = None) -> NoReturn:
    """Print what a command would do with the input that it has checked, and end it."""
    for name, value in (facts or {}).items():
        typer.echo(fact_line(name, value))
    files = ", ".join(str(path) for path in writes)
    typer.echo(fact_line("would write", files or "no file"))
    typer.echo(_DRY_RUN)
    raise typer.Exit


def _title(name: str) -> str:
    """Return a machine name in words, without its unit."""
    words = _UNIT.sub("", name.replace("_per_s", " per second")).replace("_", " ")
    return _NAMES.get(words, " ".join(_WORDS.get(word, word) for word in words.split()))


def _value(name: str, value: Any) -> str:
    """Return a value with the unit that its name ends in."""
    from survey.core.text import duration_text, length_text

    if not isinstance(value, float):
        return str(value)
    if name.endswith("length_m"):
        return length_text(value)
    found = _UNIT.search(name.replace("_per_s", ""))
    unit = "" if found is None else found.group(1)
    return duration_text(value) if unit == "s" else _UNITS.get(unit, "{:.4g}").format(value)
