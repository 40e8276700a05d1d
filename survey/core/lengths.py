"""Units of length: the names that files and column headers have for them, and their metres.

``--units`` names one of `UNITS` for heights whose file states none. A foot without further words is the international one,
which is 2 millionths shorter than the foot of United States surveys.
"""

import logging
import re
from collections.abc import Iterable
from contextvars import ContextVar

from survey.core.errors import ConfigError

FOOT_M, US_SURVEY_FOOT_M = 0.3048, 1200.0 / 3937.0
UNITS = {"m": 1.0, "ft": FOOT_M, "us-ft": US_SURVEY_FOOT_M}
"""Units of heights that can be named for a file, in metres."""
_FOOT = r"(ft|foot|feet)"
_US = r"(us|usa|u\.s\.|survey|american)"
_PATTERNS = {
    US_SURVEY_FOOT_M: rf"sft|{_FOOT}[_ -]?us|{_FOOT}[_ -]us[_ -]?survey|({_US}[_ -]?)+{_FOOT}",
    FOOT_M: rf"ift|((international|intl|int)[_ -]?)?{_FOOT}|{_FOOT}[_ -]?(intl|international)",
    1e-3: "mm|millimet(er|re)s?",
    1e-2: "cm|centimet(er|re)s?",
    1e-1: "dm|decimet(er|re)s?",
    1.0: "m|met(er|re)s?",
    1e3: "km|kilomet(er|re)s?",
}
_NAMED = {metres: re.compile(pattern, re.IGNORECASE) for metres, pattern in _PATTERNS.items()}
_NAMES = {FOOT_M: "feet", US_SURVEY_FOOT_M: "US survey feet", 1.0: "metres"}
_SAME = 1e-9
# Numbers in metres, with their standard deviation or the end of their range where they have one; no areas, volumes or velocities.
_IN_METRES = re.compile(
    r"([+-]?\d[\d,]*(?:\.\d+)?)(?:( ± | to | and )([+-]?\d[\d,]*(?:\.\d+)?))? m(?![\w²³/-])"
)
_shown_foot: ContextVar[float | None] = ContextVar("shown_foot", default=None)


def metres_in(unit: str) -> float | None:
    """Return the metres of a unit of length by its name; None where it is no known one.

    >>> metres_in("ft"), metres_in("US survey foot") == metres_in("ftUS") == metres_in("us-ft"), metres_in("K")
    (0.3048, True, None)
    """
    return next((metres for metres, name in _NAMED.items() if name.fullmatch(unit.strip())), None)


def named_units(name: str) -> float:
    """Return the metres of a unit that ``--units`` may name, or refuse.

    >>> named_units("ft")
    0.3048
    """
    if name not in UNITS:
        raise ConfigError(f"--units is {name!r}; one of {', '.join(UNITS)} was expected.")
    return UNITS[name]


def length_name(metres: float) -> str:
    """Return the name of a unit of so many metres.

    >>> length_name(0.3048), length_name(0.01)
    ('feet', 'units of 0.01 m')
    """
    return next(
        (name for known, name in _NAMES.items() if same_length(known, metres)), f"units of {metres:g} m"
    )


def same_length(a: float, b: float) -> bool:
    """Return whether two units have the same metres; those of the two feet differ by 2 millionths."""
    return abs(a - b) <= _SAME * max(a, b)


def log_converted(where: str, parts: Iterable[tuple[str, float]]) -> None:
    """Log which parts of a file were in another unit than metres, such as its heights, and were converted."""
    parts = list(parts)
    for _, metres in parts:
        show_feet(metres)
    said = [
        f"its {what} in {length_name(metres)} ({metres:.10g} m each)"
        for what, metres in parts
        if metres != 1.0
    ]
    if said:
        logging.getLogger(__name__).warning(
            "%s has %s; they are converted to metres.", where, " and ".join(said)
        )


def show_feet(metres: float) -> None:
    """Let results of this context be stated in a foot of so many metres too; other units change nothing."""
    if abs(metres - FOOT_M) < 1e-5:
        _shown_foot.set(metres)


def in_both(line: str) -> str:
    """Return a line of results with its metres in feet too, where files in feet were read or feet were asked for.

    >>> from contextvars import copy_context
    >>> copy_context().run(lambda: (show_feet(0.3048), in_both("RMSE 0.30 m, 3 m², 1.50 ± 0.15 m"))[1])
    'RMSE 0.30 m (0.98 ft), 3 m², 1.50 ± 0.15 m (4.92 ± 0.49 ft)'
    """
    foot = _shown_foot.get()
    if foot is None:
        return line

    def feet(number: str) -> str:
        return f"{float(number.replace(',', '')) / foot:.{len(number.partition('.')[2])}f}"

    def both(found: re.Match[str]) -> str:
        second = f"{found[2]}{feet(found[3])}" if found[3] else ""
        return f"{found[0]} ({feet(found[1])}{second} ft)"

    return _IN_METRES.sub(both, line)
