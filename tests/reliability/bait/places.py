"""Files that lead elsewhere: where they lead, and how they are written."""

from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import numpy as np

UTM = "EPSG:32608"
CANARY = 1234.5


class Places(NamedTuple):
    """Where the bait leads: an address that is listened to, and a file that must not be read."""

    url: str
    canary: Path


Bait = Callable[[Path, Places], Path]
"""Writes a file into a folder and returns its path."""


def text_bait(file: str, text: Callable[[Places], str]) -> Bait:
    """Return a bait that is a text file of that name."""

    def write(folder: Path, places: Places) -> Path:
        (folder / file).write_text(text(places))
        return folder / file

    return write


def laid(write: Bait, folder: Path, url: str) -> Path:
    """Write a bait and its canary, and return the path of the bait."""
    canary = folder / "canary" / "canary.bin"
    canary.parent.mkdir()
    canary.write_bytes(np.full((40, 40), CANARY).tobytes())
    return write(folder, Places(url, canary))
