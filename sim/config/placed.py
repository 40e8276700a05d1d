"""Settings of a file that names other files."""

from pathlib import Path
from typing import Self

from pydantic import PrivateAttr

from survey.core.config import Section


class PlacedSection(Section):
    """Settings of a file; paths in it count from its folder."""

    _folder: Path = PrivateAttr(default=Path())

    def read_from(self, folder: Path) -> Self:
        """Return the settings with their relative paths counted from `folder`.

        Parameters
        ----------
        folder : pathlib.Path
            Folder of the file that was read.

        Returns
        -------
        PlacedSection
            The same settings.
        """
        placed = self.model_copy()
        placed._folder = folder
        return placed

    def path(self, file: str) -> Path:
        """Return the place of a file that the settings name.

        Parameters
        ----------
        file : str
            Path as the settings name it.

        Returns
        -------
        pathlib.Path
            Relative paths count from the folder of the file that was read.
        """
        return self._folder / file
