"""Write a document: a folder, one HTML file, or a PDF."""

import base64
from pathlib import Path

from survey.core.errors import ConfigError
from survey.core.files.replacing import replacing_folder
from survey.core.files.writing import replacing
from survey.figures.sheets.pages import pdf_bytes
from survey.reporting.document.content import Document
from survey.reporting.document.pdf import document_pages
from survey.reporting.picture import Picture, picture_of
from survey.reporting.rendering import rendered

OUTPUTS = ("index.html", "report.pdf", "figures", "figures/*", "tables", "tables/*")
"""Files that are written into a folder."""
SUFFIXES = (".html", ".pdf")
"""Endings of single files; a name without ending is a folder."""


def check_target(target: str | Path) -> Path:
    """Refuse a file of another kind.

    Parameters
    ----------
    target : str or pathlib.Path
        Folder, or file that ends in ``.html`` or ``.pdf``.

    Returns
    -------
    pathlib.Path
        The target.

    Raises
    ------
    ConfigError
        Another ending.
    """
    path = Path(target)
    if path.suffix.lower() not in ("", *SUFFIXES):
        raise ConfigError(
            f"a report cannot be written to {path.name}; a folder or a file that ends in .html or .pdf was expected."
        )
    return path


def write_document(target: str | Path, document: Document) -> Path:
    """Write a document; the ending of the target chooses the form. Equal documents give equal bytes.

    Parameters
    ----------
    target : str or pathlib.Path
        ``.pdf``: A4 pages. ``.html``: one page with everything inside. Anything without ending: a folder with
        ``index.html``, ``report.pdf``, ``figures/*.png`` and ``tables/*.csv``.
    document : Document
        Its content.

    Returns
    -------
    pathlib.Path
        The file to open.

    Raises
    ------
    ConfigError
        Another ending.
    """
    path = check_target(target)
    if not path.suffix:
        return _write_folder(path, document)
    with replacing(path) as draft:
        if path.suffix.lower() == ".pdf":
            draft.write_bytes(_pdf(document))
        else:
            draft.write_text(html_page(document), encoding="utf-8")
    return path


def html_page(document: Document) -> str:
    """Return the HTML page, which holds its downloads."""
    return _page(document, _pictures(document), is_alone=True)


def _pictures(document: Document) -> dict[str, Picture]:
    return {it.name: picture_of(it.figure, it.alt, it.caption) for it in document.figures}


def _page(document: Document, pictures: dict[str, Picture], *, is_alone: bool) -> str:
    """Return the HTML page; alone it holds its downloads, else they are files beside it."""
    tables = {table.name: _table_source(table.csv) for table in document.tables}
    links = (
        {**{name: it.file_source for name, it in pictures.items()}, **tables}
        if is_alone
        else {**{name: f"figures/{name}.png" for name in pictures}, **{n: f"tables/{n}.csv" for n in tables}}
    )
    return rendered("document.html.j2", document=document, pictures=pictures, links=links)


def _write_folder(folder: Path, document: Document) -> Path:
    pictures = _pictures(document)
    with replacing_folder(folder, own=OUTPUTS) as draft:
        for place in ("figures", "tables"):
            (draft / place).mkdir()
        for name, picture in pictures.items():
            (draft / "figures" / f"{name}.png").write_bytes(picture.image)
        for table in document.tables:
            (draft / "tables" / f"{table.name}.csv").write_text(table.csv, encoding="utf-8", newline="\n")
        (draft / "index.html").write_text(_page(document, pictures, is_alone=False), encoding="utf-8")
        (draft / "report.pdf").write_bytes(_pdf(document))
    return folder / "index.html"


def _pdf(document: Document) -> bytes:
    return pdf_bytes(document_pages(document), f"{document.kind}: {document.title}")


def _table_source(text: str) -> str:
    return "data:text/csv;base64," + base64.b64encode(text.encode("utf-8")).decode("ascii")
