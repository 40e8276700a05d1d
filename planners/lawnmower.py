"""The lawnmower: straight parallel swaths, driven back and forth."""

from planners.swaths import ReferenceLines, Swath


def lawnmower(lines: ReferenceLines) -> list[Swath]:
    """Return the reference lines themselves, in boustrophedon order."""
    return [Swath(axis, axis) for axis in lines.back_and_forth]
