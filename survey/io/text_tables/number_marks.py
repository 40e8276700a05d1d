r"""Marks in the numbers of a text table: decimal point or comma, and separators of thousands.

Apostrophes and blanks between groups of three digits can only separate thousands. A comma or a point does so in a table
that proves it: by a number with both marks (1,234.5 or 1.234,5), or with one of them twice (1,234,567).
"""

import re
from collections.abc import Iterable
from typing import NamedTuple

_NUMBER = r"[+-]?\d{{1,3}}({0}\d{{3}})+"
_BLANKS = re.compile(_NUMBER.format("['\u2019 \u00a0\u202f]") + r"([.,]\d*)?")
_GROUPED = {
    mark: re.compile(_NUMBER.format(re.escape(mark)) + rf"({other}\d*)?")
    for mark, other in ((",", r"\."), (".", ","))
}
_PROOFS = {
    mark: re.compile(rf"[+-]?\d{{1,3}}(({group}\d{{3}})+{other}\d+|({group}\d{{3}}){{2,}})")
    for mark, group, other in ((",", ",", r"\."), (".", r"\.", ","))
}


class NumberMarks(NamedTuple):
    """Decimal mark of a table, and the mark that separates thousands beside apostrophes and blanks; "" for none."""

    decimal: str = "."
    thousands: str = ""

    @classmethod
    def among(cls, cells: Iterable[str], *, has_commas: bool) -> "NumberMarks":
        """Return the marks of a table by its cells; `has_commas` is true where commas do not separate cells.

        Examples
        --------
        >>> NumberMarks.among(["1,234.5", "812.5", "2,001"], has_commas=True)
        NumberMarks(decimal='.', thousands=',')
        >>> NumberMarks.among(["812,5", "2,001"], has_commas=True)
        NumberMarks(decimal=',', thousands='')
        """
        proved, has_decimal_commas = set(), False
        for cell in map(_without_blanks, cells):
            proved |= {mark for mark, proof in _PROOFS.items() if proof.fullmatch(cell)}
            has_decimal_commas |= has_commas and "," in cell and is_decimal(cell)
        if proved == {","}:
            return cls(".", ",")
        if proved == {"."}:
            return cls(",", ".")
        return cls("," if has_decimal_commas else ".")

    def plain(self, cell: str) -> str:
        """Return a cell with a decimal point and without separators of thousands; what is no number as it is.

        Examples
        --------
        >>> NumberMarks().plain("1'234.5"), NumberMarks(",", ".").plain("1.234,5"), NumberMarks(",").plain("1.234")
        ('1234.5', '1234.5', '1;234')
        """
        text = _without_blanks(cell)
        if self.thousands and _GROUPED[self.thousands].fullmatch(text):
            text = text.replace(self.thousands, "")
        if self.decimal == ".":
            return text
        return text.replace(".", ";").replace(",", ".")


def _without_blanks(cell: str) -> str:
    """Return a number without the apostrophes and blanks that separate its thousands; what is no number as it is."""
    text = cell.strip()
    return re.sub(r"['\u2019 \u00a0\u202f]", "", text) if _BLANKS.fullmatch(text) else text


def is_decimal(cell: str) -> bool:
    """Return whether a cell is a number with a decimal point or a decimal comma."""
    try:
        float(cell.strip().replace(",", ".", 1))
    except ValueError:
        return False
    return "_" not in cell
