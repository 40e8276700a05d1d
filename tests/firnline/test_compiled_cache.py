"""Compiled loops are stored where the user may write, apart for each version, or for one process alone."""

import os
import tempfile
from importlib.metadata import version
from pathlib import Path

import pytest

from firnline.__main__ import name_cache


@pytest.fixture
def environment(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> dict[str, str]:
    """Return the environment of a process without a named folder, whose caches and temporary files lie apart."""
    found = {name: text for name, text in os.environ.items() if name != "NUMBA_CACHE_DIR"}
    monkeypatch.setattr(os, "environ", found | {"XDG_CACHE_HOME": str(tmp_path / "caches")})
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    return os.environ  # type: ignore[return-value]


def test_an_installation_that_can_be_written_keeps_its_loops(environment, tmp_path) -> None:
    name_cache(tmp_path)
    assert "NUMBA_CACHE_DIR" not in environment


def test_a_folder_that_is_named_is_kept(environment, tmp_path) -> None:
    environment["NUMBA_CACHE_DIR"] = "mine"
    name_cache(tmp_path / "read-only")
    assert environment["NUMBA_CACHE_DIR"] == "mine"


def test_users_of_one_installation_have_folders_of_their_own(environment, tmp_path) -> None:
    name_cache(tmp_path / "read-only")
    place = Path(environment["NUMBA_CACHE_DIR"])
    assert place == tmp_path / "caches" / "firnline" / f"compiled-{version('firnline')}"
    assert place.is_dir()


def test_a_process_without_a_folder_gets_one_for_itself(environment, tmp_path) -> None:
    (tmp_path / "caches").write_text("no folder")
    name_cache(tmp_path / "read-only")
    place = Path(environment["NUMBA_CACHE_DIR"])
    assert place.parent == tmp_path
    assert place.name.startswith("firnline-compiled-")
