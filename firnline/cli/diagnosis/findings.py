"""Finding of a check, with what it prevents."""

from typing import NamedTuple


class Finding(NamedTuple):
    """What was checked, what was found, whether it is well, and what does not run where it is not."""

    what: str
    found: str
    is_well: bool = True
    prevents: str = ""
