"""Rendering of HTML pages from the templates of this folder."""

import base64
import csv
import io
from collections.abc import Iterable, Sequence

from jinja2 import Environment, PackageLoader, StrictUndefined

from survey.core.text import csv_cell

_SPACES = str.maketrans({"\u00a0": " ", "\u202f": "", "\u2009": "", "\u2212": "-"})


def rendered(template: str, **content: object) -> str:
    """Return a page from its template; text is escaped, and a name that is missing is an error.

    Parameters
    ----------
    template : str
        Name of a file in ``survey/reporting/templates``.
    **content
        Values by their names in the template.

    Returns
    -------
    str
        HTML.
    """
    environment = Environment(
        loader=PackageLoader("survey.reporting", "templates"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )
    environment.filters["csv_source"] = csv_source
    return environment.get_template(template).render(**content)


def csv_source(rows: Iterable[Sequence[object]]) -> str:
    r"""Return rows as a data URI of CSV, for the download of a table; formulas are escaped.

    Examples
    --------
    >>> base64.b64decode(csv_source([["RMSE", "0.4\u00a0m"]]).split(",")[1]).decode()
    'RMSE,0.4 m\n'
    """
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    for row in rows:
        plain = [str(cell).translate(_SPACES) for cell in row]
        # A minus sign begins numbers, not formulas.
        writer.writerow([cell if cell[:2].strip("-").isdigit() else csv_cell(cell) for cell in plain])
    return "data:text/csv;base64," + base64.b64encode(text.getvalue().encode("utf-8")).decode("ascii")
