"""Printing of error statistics, and writing of reports."""

from datetime import UTC, datetime
from typing import TYPE_CHECKING, Any

import typer

from firnline.cli.facts import figure_lines
from firnline.cli.scoring.request import ScoreRequest

if TYPE_CHECKING:
    from survey.reporting.document import Document


def print_statistics(figures: dict[str, Any]) -> None:
    """Print error statistics, one line each."""
    for line in figure_lines(figures):
        typer.echo(line)


def today() -> str:
    """Return the date in words, as reports state it."""
    return f"{datetime.now(UTC):%d %B %Y}"


def written(request: ScoreRequest, document: "Document") -> None:
    """Write a report and state where."""
    from survey.reporting.document import write_document

    assert request.report is not None
    target = write_document(request.report, document)
    typer.echo(f"report written to {target}", err=request.as_json)
