"""Everybody's first minutes: version, completion, dry runs, examples, help, settings, messages, the doctor."""

import json
import re
from pathlib import Path

import pytest

from tests.first_day.conftest import Firnline

pytestmark = pytest.mark.walkthrough


def test_version_help_and_completion(firnline: Firnline) -> None:
    assert re.fullmatch(r"firnline \d+\.\d+\.\d+\S*\n", firnline("--version").stdout)
    assert "--prior" in firnline("help", "plan").stdout
    assert ".geojson" in firnline("help", "FORMATS").stdout
    assert "--install-completion" in firnline("--help").stdout


def test_examples_are_copied_and_run_dry(firnline: Firnline, here: Path) -> None:
    listed = firnline("example").stdout
    assert "srtm_ridge" in listed
    firnline("example", "srtm-ridge")
    said = firnline("run", "srtm_ridge.toml", "--dry-run").stdout
    assert said.endswith("nothing was written (--dry-run)\n")
    assert not (here / "results").exists()


def test_settings_are_explained_and_have_a_schema(firnline: Firnline, here: Path) -> None:
    firnline("init", "mine.toml")
    explained = (here / "mine.toml").read_text()
    assert "#:schema" in explained
    assert explained.count("#") > 50
    assert json.loads(firnline("schema", "mission").stdout)["properties"]["planner"]


def test_a_newer_schema_is_named_with_what_to_do(firnline: Firnline, here: Path) -> None:
    (here / "newer.toml").write_text('schema_version = 99\nname = "n"\n')
    refused = firnline("run", "newer.toml", code=4).stderr
    assert "99" in refused
    assert "firnline" in refused.split(":", 1)[1]


def test_the_doctor_states_what_will_run(firnline: Firnline) -> None:
    said = firnline("doctor").stdout
    assert "both demos will run" in said
    assert "physics engine" in said


def test_a_run_ends_in_a_report_with_downloads(firnline: Firnline, here: Path) -> None:
    from tests.first_day.test_glaciologist import small_run

    page = (small_run(firnline, here) / "6-report" / "index.html").read_text()
    n_figures, n_tables = page.count("<figure"), page.count("<table")
    assert page.count('class="download"') >= n_figures + min(n_tables, 3)
    assert "<details" in page
