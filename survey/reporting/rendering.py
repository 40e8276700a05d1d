"""Rendering of HTML pages from the templates of this folder."""

from jinja2 import Environment, PackageLoader, StrictUndefined


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
    return environment.get_template(template).render(**content)
