"""Quantities as text, escaping of names for the terminal and for CSV, and shared paragraphs of docstrings.

Lengths, areas, durations, energies and angles are written in the units that people read, with rounded numbers. Names
that come from files are escaped before they are shown in a terminal or written to a table.
"""

import math
import unicodedata
from collections.abc import Callable, Mapping
from inspect import cleandoc
from string import Template
from typing import Any, TypeVar

_HOUR_S, _KWH_J = 3600.0, 3.6e6

_Function = TypeVar("_Function", bound=Callable[..., Any])


def duration_text(seconds: float) -> str:
    """Write a duration in hours and minutes.

    `seconds`: not negative [s].

    >>> duration_text(10_560.0), duration_text(341.7), duration_text(42.0)
    ('2 h 56 min', '6 min', '42 s')
    """
    if round(seconds) < 60:
        return f"{seconds:.0f} s"
    minutes = round(seconds / 60.0)
    hours, rest = divmod(minutes, 60)
    return f"{hours} h {rest:02d} min" if hours else f"{minutes} min"


def energy_text(joules: float) -> str:
    """Write an energy in kilowatt-hours, below 0.1 kWh in watt-hours.

    `joules`: energy [J].

    >>> energy_text(5.33e6), energy_text(156_491.0)
    ('1.48 kWh', '43.5 Wh')
    """
    kwh = joules / _KWH_J
    return f"{kwh:,.3g} kWh" if kwh >= 0.1 else f"{1000.0 * kwh:.3g} Wh"


def length_text(metres: float) -> str:
    """Write a length in metres, from one kilometre on in kilometres.

    `metres`: length [m].

    >>> length_text(301.4), length_text(12_345.0)
    ('301 m', '12.35 km')
    """
    if round(metres) < 1000:
        return f"{metres:.0f} m" if metres >= 10.0 else f"{metres:.2g} m"
    return f"{metres / 1000.0:,.2f} km"


def area_text(square_metres: float) -> str:
    """Write an area in square metres, hectares or square kilometres.

    `square_metres`: area [m²].

    >>> area_text(768.0), area_text(19_300.0), area_text(1_932_837.0)
    ('768 m²', '1.93 ha', '1.93 km²')
    """
    if square_metres < 10_000.0:
        return f"{square_metres:.0f} m²"
    if square_metres < 1_000_000.0:
        return f"{square_metres / 10_000.0:.3g} ha"
    return f"{square_metres / 1_000_000.0:,.2f} km²"


def place_text(longitude_deg: float, latitude_deg: float) -> str:
    """Write latitude and longitude with six decimals, a tenth of a metre.

    `longitude_deg`, `latitude_deg`: place [deg], east and north positive.

    >>> place_text(-134.5, 58.44)
    '58.440000° N 134.500000° W'
    """
    north, east = "N" if latitude_deg >= 0.0 else "S", "E" if longitude_deg >= 0.0 else "W"
    return f"{abs(latitude_deg):.6f}° {north} {abs(longitude_deg):.6f}° {east}"


def round_number(value: float) -> float:
    """Return the largest of 1, 2 or 5 times a power of ten that is not above `value`.

    >>> [round_number(v) for v in (0.03, 1.9, 137.0)]
    [0.02, 1.0, 100.0]
    """
    power = 10.0 ** math.floor(math.log10(value) + 1e-9)
    return next(factor * power for factor in (5.0, 2.0, 1.0) if factor * power <= value * (1 + 1e-9))


# Characters by which spreadsheets take a cell for a formula.
_FORMULA_STARTS = ("=", "+", "-", "@", "\t", "\r", "\n")
_HIDDEN = frozenset({"Cc", "Cf", "Cs", "Co", "Cn", "Zl", "Zp"})


def printable(name: str) -> str:
    r"""Escape what a terminal would obey or hide: control characters, line breaks, changes of direction.

    Returns: the name with such characters written as ``\xNN`` or ``\uNNNN``; others stay.

    >>> printable("north\x1b[2J")
    'north\\x1b[2J'
    >>> printable("Größe 3 m²")
    'Größe 3 m²'
    """
    return "".join(_escaped(letter) if unicodedata.category(letter) in _HIDDEN else letter for letter in name)


def csv_cell(name: str) -> str:
    """Escape a name for a cell of a CSV table, so that no spreadsheet takes it for a formula.

    >>> csv_cell("=1+2")
    "'=1+2"
    >>> csv_cell("north")
    'north'
    """
    formula = name.lstrip(" ").startswith(_FORMULA_STARTS)
    return f"'{printable(name)}" if formula else printable(name)


def _escaped(letter: str) -> str:
    return letter.encode("unicode_escape").decode("ascii") if ord(letter) > 0xFF else f"\\x{ord(letter):02x}"


def insert_paragraphs(function: _Function, paragraphs: Mapping[str, str]) -> _Function:
    """Replace each ``$name`` in a function's docstring by the paragraph of that name, and return the function.

    >>> def plot(ax):
    ...     "Draw. $axes"
    >>> insert_paragraphs(plot, {"axes": "On `ax`."}).__doc__
    'Draw. On `ax`.'
    """
    if function.__doc__:  # None under ``python -OO``
        function.__doc__ = Template(cleandoc(function.__doc__)).substitute(paragraphs)
    return function
