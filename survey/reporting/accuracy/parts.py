"""Sections that accuracy reports share."""

from collections.abc import Sequence
from dataclasses import dataclass, field

from survey.core.arrays import FloatArray
from survey.figures.residuals import residual_histogram, residual_quantiles
from survey.reporting.document import Chapter, DrawnFigure, Table
from survey.reporting.quantities import number, percent
from survey.reporting.statements import template
from survey.scoring.accuracy import ErrorStatistics
from survey.scoring.class_scores import ClassScore


@dataclass(frozen=True)
class ReportSetting:
    """Names and settings that a report states.

    Parameters
    ----------
    title : str
        Name of the map or survey.
    date : str
        Date of the report.
    inputs : dict of str to str
        What was compared: name of each role with its file.
    language : str
        Language of the statements beside English.
    """

    title: str
    date: str
    inputs: dict[str, str] = field(default_factory=dict)
    language: str = "en"

    @property
    def subtitle(self) -> str:
        """Date and program."""
        return f"{self.date}, made with firnline"

    @property
    def signature(self) -> tuple[str, ...]:
        """Labels of the lines to sign on, in English and in the language of the statement."""
        labels = ("tested_by", "licence", "date", "signature")
        english, local = template("en")["words"], template(self.language)["words"]
        if self.language == "en":
            return tuple(english[label] for label in labels)
        return tuple(f"{english[label]} / {local[label]}" for label in labels)


def facts_table(name: str, caption: str, facts: dict[str, str]) -> Table:
    """Return a table of names and values."""
    return Table(name, caption, ("Quantity", "Value"), tuple(facts.items()), n_text_columns=2)


def statistics_facts(statistics: ErrorStatistics) -> dict[str, str]:
    """Return error statistics as text."""
    return {
        "Number": f"{statistics.n:,}".replace(",", "\u202f"),
        "RMSE": number(statistics.rmse_m, "m"),
        "Mean error (bias)": number(statistics.bias_m, "m"),
        "Standard deviation": number(statistics.std_m, "m"),
        "Median": number(statistics.median_m, "m"),
        "NMAD": number(statistics.nmad_m, "m"),
        "95th percentile of |error|": number(statistics.p95_m, "m"),
        "Largest |error|": number(statistics.worst_m, "m"),
        "Skewness": number(statistics.skewness, decimals=2),
        "Excess kurtosis": number(statistics.kurtosis, decimals=2),
    }


def distribution_figures(errors: FloatArray, statistics: ErrorStatistics) -> tuple[DrawnFigure, DrawnFigure]:
    """Return histogram and normal quantiles of the errors."""
    return (
        DrawnFigure(
            "histogram",
            residual_histogram(errors, statistics),
            "Histogram of the residuals with mean and RMSE",
            "Distribution of the residuals, map minus reference.",
        ),
        DrawnFigure(
            "quantiles",
            residual_quantiles(errors, statistics),
            "Residuals against quantiles of the normal distribution",
            "Residuals against normal quantiles: on the line they are normal, beyond it the tails are heavier.",
        ),
    )


def class_table(name: str, rows: Sequence[ClassScore]) -> Table:
    """Return the table of error statistics by class."""
    headings = ("Class", "n", "RMSE [m]", "NMAD [m]", "Bias [m]", "Within 1.96 σ")
    cells = tuple(
        (
            row.name,
            str(row.n),
            number(row.rmse_m),
            number(row.nmad_m),
            number(row.bias_m),
            percent(row.coverage_95),
        )
        for row in rows
    )
    return Table(f"by_{name}", f"Errors by class: {name.replace('_', ' ')}", headings, cells)


def methods_section(cited: Sequence[str]) -> Chapter:
    """Return the section of citations, each once."""
    return Chapter("Methods and standards cited", paragraphs=tuple(dict.fromkeys(cited)))
