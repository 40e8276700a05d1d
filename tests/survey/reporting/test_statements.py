"""Statements have the words of each standard, and only where its conditions are met."""

import numpy as np
import pytest

from survey import ConfigError
from survey.reporting.statements import LANGUAGES, statement, template
from survey.scoring import score_at
from survey.scoring.standards.checkpoint_errors import CheckpointErrors, Spread
from survey.scoring.standards.standards import STANDARDS

EVEN = Spread((0.25, 0.25, 0.25, 0.25), 0.1, 1e6)


def errors_of(n: int, size_m: float = 0.05, n_vegetated: int = 0) -> CheckpointErrors:
    values = size_m * np.where(np.arange(n) % 2 == 0, 1.0, -1.0)
    vegetated = np.arange(n) >= n - n_vegetated
    return CheckpointErrors(values, np.full(n, 0.02), vegetated, tuple(map(str, range(n))), EVEN)


def statements(errors: CheckpointErrors, standard: str, language: str = "en", **asked: float) -> list[str]:
    return [statement(it, language) for it in score_at(errors, (standard,), **asked).assessments]


def test_nssda_states_the_tested_accuracy_in_its_own_words() -> None:
    (said,) = statements(errors_of(20), "nssda-1998")
    assert said == "Tested 0.098 meters vertical accuracy at 95% confidence level."


def test_edition_2_is_tested_to_meet_a_class_with_thirty_points_on_each_ground() -> None:
    nva, vva = statements(errors_of(60, n_vegetated=30), "asprs-edition-2", class_m=0.10)
    assert nva.startswith("This data set was tested to meet ASPRS Positional Accuracy Standards")
    assert "Edition 2, Version 2 (2024) for a 10 (cm) RMSE_V Vertical Accuracy Class" in nva
    assert "(NVA) was found to be RMSE_V = 5.4 (cm)" in nva
    assert vva == "The Vegetated Vertical Accuracy (VVA) was found to be RMSE_V = 5.4 (cm)."


def test_fewer_than_thirty_points_take_the_reduced_statement_and_never_tested_to_meet() -> None:
    (said,) = statements(errors_of(29), "asprs-edition-2", class_m=0.10)
    assert "using ONLY 29 checkpoints" in said
    assert "tested to meet" not in said


def test_a_class_that_is_missed_or_not_asked_for_gets_no_statement_of_the_standard() -> None:
    (missed,) = statements(errors_of(30, 0.2), "asprs-edition-2", class_m=0.10)
    assert "not met" in missed
    assert "cannot be used" in missed
    (reported,) = statements(errors_of(30), "asprs-edition-2")
    assert "no class was asked for" in reported
    (few,) = statements(errors_of(19), "nssda-1998")
    assert "missing: 20 checkpoints" in few
    (coarse,) = statements(errors_of(29), "asprs-edition-2", class_m=0.03)
    assert "ONLY" not in coarse


def test_2014_equates_the_rmse_to_95_percent_and_marks_its_wording_as_unverified() -> None:
    (said,) = statements(errors_of(30), "asprs-2014", class_m=0.10)
    assert "10 (cm) RMSEz Vertical Accuracy Class" in said
    assert "RMSEz = 5.0 (cm), equating to ±9.8 (cm) at 95% confidence level" in said
    assert "[wording unverified]" in said


@pytest.mark.parametrize("language", LANGUAGES)
def test_every_language_has_a_text_for_every_standard_and_case(language: str) -> None:
    texts, english = template(language), template("en")
    assert {key: set(cases) for key, cases in texts.items()} == {k: set(c) for k, c in english.items()}
    assert set(STANDARDS) <= set(texts)


def test_the_german_statement_has_the_same_numbers() -> None:
    (said,) = statements(errors_of(30), "asprs-edition-2", "de", class_m=0.10)
    assert "Höhengenauigkeitsklasse 10 cm (RMSE_V)" in said
    assert "RMSE_V = 5.4 cm" in said


@pytest.mark.parametrize(
    ("language", "words"),
    [
        ("fr", "la classe de précision altimétrique 10 cm (RMSE_V)"),
        ("es", "la clase de exactitud vertical de 10 cm (RMSE_V)"),
    ],
)
def test_french_and_spanish_statements_have_the_same_numbers(language: str, words: str) -> None:
    (said,) = statements(errors_of(30), "asprs-edition-2", language, class_m=0.10)
    assert words in said
    assert "RMSE_V = 5.4 cm" in said
    (few,) = statements(errors_of(29), "asprs-edition-2", language, class_m=0.10)
    assert "29" in few


def test_a_language_without_a_template_is_refused() -> None:
    with pytest.raises(ConfigError, match="language 'xx'; one of en, de"):
        template("xx")
