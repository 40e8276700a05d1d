"""Write the generated pages and notebooks below ``docs/``; they are not stored in the repository."""

from collections.abc import Callable
from pathlib import Path

from generate import (
    api,
    benchmarks,
    command_line,
    examples,
    exit_codes,
    file_formats,
    honesty,
    mission_file,
    study_file,
)

Pages = dict[str, str]
REFERENCE: tuple[Callable[[], Pages], ...] = (
    api.pages,
    command_line.pages,
    mission_file.pages,
    study_file.pages,
    file_formats.pages,
    exit_codes.pages,
    benchmarks.pages,
    honesty.pages,
)
"""Each returns the texts of its pages by their paths below ``docs/``."""


def write_all(docs: Path) -> None:
    """Write all pages below `docs`, those that changed alone, and remove generated pages of names that are gone."""
    texts = {path: text for make in (*REFERENCE, examples.notebooks) for path, text in make().items()}
    for path, text in texts.items():
        target = docs / path
        target.parent.mkdir(parents=True, exist_ok=True)
        if not target.is_file() or target.read_text(encoding="utf-8") != text:
            target.write_text(text, encoding="utf-8")
    for old in (docs / "reference").rglob("*.*"):
        written = old.relative_to(docs).as_posix() in texts
        if not written and old != docs / "reference" / "index.md" and "objects" not in old.parts:
            old.unlink()
