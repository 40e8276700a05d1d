"""Classes and flags of LAS: which points are of the ground, and which are not used."""

from collections import Counter
from typing import Literal, NamedTuple

import numpy as np
import numpy.typing as npt

from survey.core import BoolArray, InputError
from survey.io.point_table import PointTable

Ground = Literal["auto", "all", "classified"]
"""Which points are mapped: by class where ground is classified and by a filter elsewhere, all, or those of the ground alone."""
GROUND = (2, 8)
"""Ground, and the key points of it that LAS 1.0 to 1.3 have."""
WITHHELD, SYNTHETIC, EARLIER = 256, 257, 258
"""Codes beyond the classes: points with those flags, and points without a class that are not the last return of their pulse."""
LEFT_OUT = {7: "noise", 18: "noise", 12: "overlap", WITHHELD: "withheld", SYNTHETIC: "synthetic"}
"""Points that are never used, by class or code: 12 is overlap in LAS 1.0 to 1.3, which the producer had left out of the ground."""


class Chosen(NamedTuple):
    """Points that may be mapped, how many others there were by reason, and how the ground was found; None where it was not."""

    table: PointTable
    left_out: Counter[str]
    how: str | None

    def notes(self, where: str) -> tuple[str, ...]:
        """Return the sentence about the points that are used; none where all are, and no filter was applied."""
        counts = [f"{count:,} {reason}" for reason, count in self.left_out.items()]
        if not counts and self.how in (None, "by class"):
            return ()
        n, ending = self.table.n, f"; left out: {', '.join(counts)}" if counts else ""
        found = "" if self.how is None else f", ground {self.how}"
        return (f"{where}: {n} of {n + self.left_out.total()} points are used{found}{ending}.",)

    def without(self, kept: BoolArray, reason: str) -> "Chosen":
        """Return the points that are kept, the others counted under a reason."""
        return self._replace(
            table=self.table.select(kept),
            left_out=self.left_out + Counter({reason: int((~kept).sum())}),
        )


def choose_points(table: PointTable, ground: Ground | None, where: str) -> Chosen:
    """Return the points that may be mapped by class and flags; None as `ground` stands for ``auto``."""
    if table.classes is None:
        if ground == "classified":
            raise InputError(
                f"{where} states no classes of points, which LAS and LAZ have; take --ground auto, or all."
            )
        return Chosen(table, Counter(), None)
    classes = table.classes
    is_ground, left_out = np.isin(classes, GROUND), is_left_out(classes)
    if ground == "classified" and not is_ground.any():
        raise InputError(
            f"{where} holds no point that is classified as ground (class 2 or 8); take --ground auto, or all."
        )
    if left_out.all():
        raise InputError(f"{where} holds noise and withheld points alone; no ground can be mapped from it.")
    by_class = is_ground.any() and ground != "all"
    kept = is_ground if by_class else ~left_out
    reasons: Counter[str] = Counter()
    for code, count in zip(*np.unique(classes[~kept], return_counts=True), strict=True):
        reasons[LEFT_OUT.get(int(code), "of other classes")] += int(count)
    return Chosen(table.select(kept), reasons, "by class" if by_class else None)


def is_left_out(classes: npt.NDArray[np.uint16]) -> BoolArray:
    """Return which points are never used, by their classes and codes (N,)."""
    found: BoolArray = np.isin(classes, list(LEFT_OUT))
    return found
