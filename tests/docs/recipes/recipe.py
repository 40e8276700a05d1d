"""Recipe of CONTRIBUTING.md that is followed once: the files that an extension adds, and the lines it inserts."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path


@dataclass(frozen=True)
class Recipe:
    """An extension of the packages, and a script that passes with it.

    Parameters
    ----------
    heading : str
        Heading in CONTRIBUTING.md.
    most_files : int
        Most files that the extension may touch.
    added : mapping of str to str
        Text of new files.
    inserted : mapping of str to sequence of pairs
        For each changed file, lines that exist and what is inserted before each of them.
    check : str
        Python that uses the extension.
    """

    heading: str
    most_files: int
    check: str
    added: Mapping[str, str] = field(default_factory=dict)
    inserted: Mapping[str, tuple[tuple[str, str], ...]] = field(default_factory=dict)

    def follow(self, root: Path) -> None:
        """Change the packages below a folder."""
        for name, text in self.added.items():
            (root / name).write_text(text, encoding="utf-8")
        for name, insertions in self.inserted.items():
            text = (root / name).read_text(encoding="utf-8")
            for anchor, new in insertions:
                assert text.count(anchor) == 1, f"{name}: {anchor!r}"
                text = text.replace(anchor, new + anchor)
            (root / name).write_text(text, encoding="utf-8")
