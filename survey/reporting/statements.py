"""Accuracy statements in the words of the standards, from one template for each language."""

import re
import tomllib
from functools import cache
from importlib.resources import files

from survey.core.errors import ConfigError
from survey.scoring.standards.assessment import NOT_ASSESSED, Assessment
from survey.scoring.standards.standards import ASPRS_2014, EDITION_2, NMAS, Z95

LANGUAGES = ("en", "de", "es", "fr")
"""Languages for which there is a template in the folder ``templates``."""
_TOO_FEW = re.compile(r"\d+ checkpoints on ")


@cache
def template(language: str) -> dict[str, dict[str, str]]:
    """Return the template of a language: texts by standard and case."""
    if language not in LANGUAGES:
        raise ConfigError(
            f"there is no accuracy statement in the language {language!r}; one of {', '.join(LANGUAGES)} was expected."
        )
    text = files("survey.reporting").joinpath("templates", f"{language}.toml").read_text(encoding="utf-8")
    return tomllib.loads(text)


def statement(finding: Assessment, language: str = "en") -> str:
    """Return the accuracy statement for a finding.

    Where the conditions of the standard are met it has the standard's own words; where not, it says so in words
    that cannot be mistaken for them.

    >>> from survey.scoring.standards.checkpoint_errors import Spread
    >>> even = Spread((0.25, 0.25, 0.25, 0.25), 0.1, 1e6)
    >>> found = Assessment("nssda-1998", "NSSDA", "", "accuracy", 0.098, None, "reported", 30, 0.02, even)
    >>> statement(found)
    'Tested 0.098 meters vertical accuracy at 95% confidence level.'
    """
    texts = template(language)
    case = _case(finding)
    if finding.kind != "vertical" and case not in texts["own"]:
        case = f"{finding.kind}_{case}"
    wording = texts["own"].get(case) or texts[finding.standard][case]
    return wording.format(**_values(finding))


def _case(finding: Assessment) -> str:
    """Return which statement of the template a finding allows."""
    if finding.outcome == NOT_ASSESSED:
        return "reduced" if _has_too_few_only(finding) else "withheld"
    if finding.outcome == "not met":
        return "not_met"
    if finding.is_vegetated:
        return "vegetated"
    has_statement = finding.outcome == "met" or (finding.limit is None and not _has_classes(finding))
    return "tested" if has_statement else "reported"


def _has_classes(finding: Assessment) -> bool:
    return finding.standard in (ASPRS_2014, EDITION_2)


def _has_too_few_only(finding: Assessment) -> bool:
    """Return whether Edition 2 allows its statement for fewer than thirty checkpoints."""
    return (
        finding.standard == EDITION_2
        and finding.limit is not None
        and finding.value <= finding.limit
        and not finding.is_vegetated
        and all(_TOO_FEW.match(condition) for condition in finding.missing)
    )


def _values(finding: Assessment) -> dict[str, object]:
    """Return the values of a template by their names."""
    scale = 1.0 if finding.standard == NMAS else 100.0
    return {
        "edition": finding.edition,
        "map_class": finding.map_class,
        "class_cm": finding.map_class.removesuffix(" cm class"),
        "measure": finding.measure,
        "value_m": f"{finding.value:.3f}",
        "value_cm": f"{scale * finding.value:.1f}",
        "rmse_cm": f"{100.0 * finding.value / Z95:.1f}",
        "limit_m": "–" if finding.limit is None else f"{finding.limit:.3f}",
        "missing": "; ".join(finding.missing),
        "n": finding.n,
    }
