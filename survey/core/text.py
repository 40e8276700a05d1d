"""Escaping of names that come from files, before they are shown in a terminal or written to a table."""

import unicodedata

# Characters by which spreadsheets take a cell for a formula.
_FORMULA_STARTS = ("=", "+", "-", "@", "\t", "\r", "\n")
_HIDDEN = frozenset({"Cc", "Cf", "Cs", "Co", "Cn", "Zl", "Zp"})


def printable(name: str) -> str:
    r"""Escape what a terminal would obey or hide: control characters, line breaks, changes of direction.

    Parameters
    ----------
    name : str
        A name from a file, or a message that holds one.

    Returns
    -------
    str
        The name with such characters written as ``\xNN`` or ``\uNNNN``; others stay.

    Examples
    --------
    >>> printable("north\x1b[2J")
    'north\\x1b[2J'
    >>> printable("Größe 3 m²")
    'Größe 3 m²'
    """
    return "".join(_escaped(letter) if unicodedata.category(letter) in _HIDDEN else letter for letter in name)


def csv_cell(name: str) -> str:
    """Escape a name for a cell of a CSV table, so that no spreadsheet takes it for a formula.

    Parameters
    ----------
    name : str
        A name from a file. Numbers are written as they are, not through this function.

    Returns
    -------
    str
        `printable`, with an apostrophe before a formula's first character. Commas and quotes stay:
        `csv.writer` quotes them.

    Examples
    --------
    >>> csv_cell("=1+2")
    "'=1+2"
    >>> csv_cell("north")
    'north'
    """
    formula = name.lstrip(" ").startswith(_FORMULA_STARTS)
    return f"'{printable(name)}" if formula else printable(name)


def _escaped(letter: str) -> str:
    return letter.encode("unicode_escape").decode("ascii") if ord(letter) > 0xFF else f"\\x{ord(letter):02x}"
