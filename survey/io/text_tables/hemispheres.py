"""Columns that state the hemisphere of a latitude or a longitude beside it."""

from survey.core.arrays import FloatArray
from survey.core.errors import InputError
from survey.io.text_tables.delimited import TextTable


def refuse_hemispheres(table: TextTable, longitude: FloatArray, latitude: FloatArray) -> None:
    """Refuse a table whose degrees count to the south or the west in a column of their own, without a sign.

    Parameters
    ----------
    table : TextTable
        The table.
    longitude, latitude : (N,) ndarray
        Degrees as it states them.

    Raises
    ------
    InputError
        A column of ``N`` and ``S``, or of ``E`` and ``W``, has an ``S`` or a ``W`` beside a positive number.
    """
    for name in table.header:
        cells = [cell.upper() for cell in table.texts(name)]
        for letters, negative, degrees in (("NS", "S", latitude), ("EW", "W", longitude)):
            is_hemisphere = all(cell and cell in letters and len(cell) == 1 for cell in cells)
            if is_hemisphere and any(c == negative and v > 0.0 for c, v in zip(cells, degrees, strict=True)):
                raise InputError(
                    f"{table.where} states {negative} in the column {name} beside degrees without a sign; "
                    "write those with a minus sign and remove the column."
                )
