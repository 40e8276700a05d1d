"""Reference pages that are generated from the code."""

import re
import sys
from importlib import import_module
from pathlib import Path

import pytest

DOCS = Path(__file__).resolve().parents[2] / "docs"


@pytest.fixture(scope="module")
def pages():
    sys.path.insert(0, str(DOCS))
    try:
        module = import_module("generate.pages")
        yield {path: text for make in module.REFERENCE for path, text in make().items()}
    finally:
        sys.path.remove(str(DOCS))


@pytest.mark.parametrize(
    "package", ["firnline", "firnline.actions", "survey", "survey.reconstruction", "planners", "vision_slam"]
)
def test_every_public_name_has_a_page_or_a_link_to_one(pages, package):
    api = import_module("generate.api")
    homes = set(api.homes().values())
    text = pages[f"reference/api/{package}.rst"]
    listed = {
        line.strip().lstrip("~").rpartition(".")[2] for line in text.splitlines() if line.startswith("   ")
    }
    module = import_module(package)
    assert set(module.__all__) - {"__version__"} <= listed
    assert all(home.rpartition(".")[0] in api.PACKAGES for home in homes)


def test_every_command_has_a_page_with_all_its_options(pages):
    command_line = import_module("generate.command_line")
    for name, command in command_line.commands().items():
        text = pages[f"reference/commands/{name}.md"]
        for parameter in command.params:
            if parameter.param_type_name == "option":
                assert parameter.opts[0] in text


def test_every_setting_of_a_mission_has_a_row_with_a_meaning(pages):
    models, mission = import_module("generate.models"), import_module("sim.config.mission")
    text = pages["reference/mission-file.md"]
    for _, section in models.sections(mission.MissionConfig):
        for name, field in section.model_fields.items():
            if not any(models.models_in(field.annotation)):
                assert models.row(name, field)[4]
                assert f"| `{name}` |" in text


def test_units_come_from_the_meaning_or_the_name():
    models = import_module("generate.models")
    assert models.unit_of("speed_m_s", "Speed.") == "m/s"
    assert models.unit_of("base_residual", "Share that is left [1].") == "1"
    assert models.unit_of("name", "Name.") == ""


def test_rows_of_benchmarks_that_miss_their_limit_are_shown(pages):
    benchmarks = import_module("generate.benchmarks")
    assert (
        benchmarks.row({"name": "x", "value": 2.0, "unit": "m", "bar": "<= 1", "holds": False})[4]
        == "**missed**"
    )
    assert "reference/benchmarks/planning.md" in pages


def test_the_pages_state_the_exit_code_of_every_refusal(pages):
    codes = re.findall(r"\| `(\d+)` \|", pages["reference/exit-codes.md"])
    assert {"0", "1", "2", "3", "4", "5", "130", "141"} <= set(codes)


def test_every_figure_of_honesty_has_a_command_and_a_value(pages):
    honesty = import_module("generate.honesty")
    rows = [
        [cell.strip() for cell in line.strip("|").split(" | ")]
        for line in pages["reference/honesty.md"].splitlines()
        if line.startswith("| ")
    ][2:]
    stored = import_module("generate.benchmarks").stored_tables()
    assert len(rows) == sum(len(names) for stem, names in honesty.FIGURES.items() if stem in stored)
    for _, command, value, *_ in rows:
        assert re.fullmatch(r"`python -m benchmarks\.\w+`", command)
        assert re.match(r"`[\d.]", value)
