"""Links are resolved without an error, whatever they lead to."""

from pathlib import Path

from firnline.actions.interface import refuse_existing
from survey.core.replacement import resolved


def test_a_link_leads_to_its_file(tmp_path: Path) -> None:
    (tmp_path / "link").symlink_to("file")
    assert resolved(tmp_path / "link") == resolved(tmp_path) / "file"


def test_a_circle_of_links_is_no_fault(tmp_path: Path) -> None:
    (tmp_path / "a").symlink_to("b")
    (tmp_path / "b").symlink_to("a")
    resolved(tmp_path / "a")
    refuse_existing([tmp_path / "out"], force=False, inputs=[tmp_path / "a"])
