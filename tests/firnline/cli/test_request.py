"""Commands whose options are the fields of a dataclass."""

from dataclasses import dataclass, field
from typing import Annotated

import pytest
import typer
from typer.testing import CliRunner

from firnline.cli.request import with_options_of


@dataclass(frozen=True, kw_only=True)
class _Common:
    quiet: Annotated[bool, typer.Option("--quiet")] = False


@dataclass(frozen=True, kw_only=True)
class _Survey(_Common):
    site: Annotated[str, typer.Argument()]
    spacing_m: Annotated[float, typer.Option("--spacing")] = 10.0
    settings: Annotated[list[str], typer.Option("--set")] = field(default_factory=list)


@pytest.fixture
def requests() -> list[_Survey]:
    return []


@pytest.fixture
def app(requests: list[_Survey]) -> typer.Typer:
    made = typer.Typer()

    @made.command()
    @with_options_of(_Survey)
    def survey(request: _Survey) -> None:
        """Survey a site."""
        requests.append(request)

    return made


def test_options_reach_the_command_as_one_request(app: typer.Typer, requests: list[_Survey]) -> None:
    words = ["glacier", "--spacing", "4", "--set", "a=1", "--set", "b=2", "--quiet"]
    result = CliRunner().invoke(app, words)
    assert result.exit_code == 0, result.output
    assert requests == [_Survey(site="glacier", spacing_m=4.0, settings=["a=1", "b=2"], quiet=True)]


def test_what_is_not_given_has_the_defaults_of_the_dataclass(
    app: typer.Typer, requests: list[_Survey]
) -> None:
    assert CliRunner().invoke(app, ["glacier"]).exit_code == 0
    assert requests == [_Survey(site="glacier")]


def test_a_field_without_a_default_must_be_given(app: typer.Typer) -> None:
    assert CliRunner().invoke(app, []).exit_code == 2


def test_help_lists_own_options_before_those_of_the_base(app: typer.Typer) -> None:
    text = CliRunner().invoke(app, ["--help"]).output
    assert "Survey a site." in text
    assert text.index("--spacing") < text.index("--quiet")
