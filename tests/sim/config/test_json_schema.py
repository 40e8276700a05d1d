"""The JSON Schema of mission and study files agrees with what is read, and newer files are refused."""

import json
import tomllib
from pathlib import Path

import pytest
from typer.testing import CliRunner

from firnline.cli.main import app

jsonschema = pytest.importorskip("jsonschema", reason="jsonschema is not installed")
EXAMPLES = sorted((Path(__file__).parents[3] / "examples").glob("*.toml"))
STUDIES = [file for file in EXAMPLES if "[[terrains]]" in file.read_text(encoding="utf-8")]


def schema(kind: str) -> "jsonschema.Draft202012Validator":
    done = CliRunner().invoke(app, ["schema", kind])
    assert done.exit_code == 0, done.output
    found = json.loads(done.stdout)
    jsonschema.Draft202012Validator.check_schema(found)
    return jsonschema.Draft202012Validator(found)


@pytest.fixture(scope="module")
def mission() -> "jsonschema.Draft202012Validator":
    return schema("mission")


@pytest.mark.parametrize("example", [file for file in EXAMPLES if file not in STUDIES], ids=str)
def test_the_example_missions_are_valid(mission, example: Path) -> None:
    assert list(mission.iter_errors(tomllib.loads(example.read_text(encoding="utf-8")))) == []


def test_the_example_study_is_valid() -> None:
    study = schema("study")
    for file in STUDIES:
        assert list(study.iter_errors(tomllib.loads(file.read_text(encoding="utf-8")))) == []


def test_a_file_of_init_names_the_schema_is_valid_and_explains_choices_and_limits(
    mission, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    assert CliRunner().invoke(app, ["init", "mine.toml"]).exit_code == 0
    text = Path("mine.toml").read_text(encoding="utf-8")
    assert text.startswith("#:schema mission.schema.json\n")
    assert list(mission.iter_errors(tomllib.loads(text))) == []
    assert "(one of class-1, class-2, class-3)" in text
    assert "(above 0)" in text


@pytest.mark.parametrize(
    "wrong",
    [{"planner": {"pattern": "lawnmower", "swats": 3}}, {"rover": {"camera_height_m": -1.0}}, {"colour": 1}],
)
def test_unknown_keys_and_values_out_of_range_are_invalid(mission, wrong: dict[str, object]) -> None:
    values = {"schema_version": 1, "name": "m", "terrain": {"source": "random"}, **wrong}
    assert list(mission.iter_errors(values))


@pytest.mark.parametrize(("command", "extra"), [("run", ""), ("montecarlo", "trials = 1\n")])
def test_a_newer_schema_is_named_with_what_to_do(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, command: str, extra: str
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("new.toml").write_text(f'schema_version = 7\nname = "m"\n{extra}')
    done = CliRunner().invoke(app, [command, "new.toml"])
    assert done.exit_code == 4
    assert "new.toml has schema_version 7, and this firnline reads version 1; update firnline" in done.stderr
