"""Changelog and its fragments."""

import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
FRAGMENTS = sorted(p for p in (ROOT / "changelog.d").iterdir() if p.name != "README.md")
KINDS = {"added", "changed", "fixed", "removed", "security"}


@pytest.mark.parametrize("fragment", FRAGMENTS, ids=lambda fragment: fragment.name)
def test_a_fragment_has_a_kind_and_ends_in_a_full_stop(fragment):
    assert re.fullmatch(r"\+[a-z0-9-]+\.([a-z]+)\.md", fragment.name)
    assert fragment.name.split(".")[1] in KINDS
    assert fragment.read_text(encoding="utf-8").rstrip().endswith(".")


def test_towncrier_drafts_the_next_release_with_every_fragment():
    command = [sys.executable, "-m", "towncrier", "build", "--draft", "--version", "9.9.9"]
    ended = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert ended.returncode == 0, ended.stderr
    assert "## [9.9.9]" in ended.stdout
    drafted = " ".join(ended.stdout.split())
    for fragment in FRAGMENTS:
        first = " ".join(fragment.read_text(encoding="utf-8").split())[:60]
        assert first in drafted, fragment.name


def test_the_version_is_not_older_than_the_last_release():
    last = re.search(r"^## \[(\d[^\]]*)\]", (ROOT / "CHANGELOG.md").read_text(encoding="utf-8"), re.MULTILINE)
    stated = re.search(
        r'^version = "(.*)"', (ROOT / "pyproject.toml").read_text(encoding="utf-8"), re.MULTILINE
    )
    assert last
    assert stated
    numbers = [[int(n) for n in re.findall(r"\d+", text[1])[:3]] for text in (stated, last)]
    assert numbers[0] >= numbers[1]
