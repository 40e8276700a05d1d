"""Run the benchmark of maps in tiles.

``python -m benchmarks.whole_glacier [--km2 1 5 25] [--density 2.9] [--part workers] [--quick]``: areas, and points for each
square metre of a strip. 25 km² with a density of 2.9 have 10⁸ points. Parts that are done are stored, and a run that was
broken off goes on with the others; ``--part`` runs some of them alone and stores no table.
"""

import argparse
import tempfile
from collections.abc import Callable, Iterable, Iterator
from functools import partial
from pathlib import Path
from typing import NamedTuple

from benchmarks.report import Row, main
from benchmarks.stored_parts import parts_folder, stored_rows
from benchmarks.whole_glacier.interrupted import killed_runs, lost_scheduler, second_worker
from benchmarks.whole_glacier.maps import exponent, made_survey, seams
from benchmarks.whole_glacier.peers import beside_others
from benchmarks.whole_glacier.planning import planned
from benchmarks.whole_glacier.rasters import streamed
from benchmarks.whole_glacier.real_strips import real_strips
from benchmarks.whole_glacier.small_surveys import small_surveys

_EVERY_PART = (
    "survey/reconstruction/tiled",
    "survey/reconstruction/lattice",
    "benchmarks/whole_glacier/made_survey.py",
    "benchmarks/whole_glacier/mapping.py",
)


class Part(NamedTuple):
    """A part of the benchmark: a function of a folder that yields rows, and the modules of the benchmark that it uses."""

    measure: Callable[[Path], Iterable[Row]]
    modules: tuple[str, ...]

    def rows(self, name: str) -> list[Row]:
        """Return the rows, measured where they are not stored yet."""
        modules = (f"benchmarks/whole_glacier/{module}.py" for module in self.modules)
        place = parts_folder("whole-glacier", *_EVERY_PART, *modules)
        with tempfile.TemporaryDirectory(prefix="firnline-tiles-") as folder:
            return stored_rows(place / f"{name}.json", partial(self.measure, Path(folder)))


def rows(sizes_km2: list[float], density: float, only: list[str], quick: bool) -> Iterator[Row]:
    """Yield the rows of all parts, or of some."""
    parts = _parts(sizes_km2[:1] if quick else sizes_km2, density, quick=quick)
    found: list[Row] = []
    for name in only or parts:
        own = parts[name].rows(name)
        found += own
        yield from own
    yield from exponent(found)


def _parts(sizes_km2: list[float], density: float, *, quick: bool) -> dict[str, Part]:
    """Return the parts by name, the long ones last; few of them where it must be quick."""
    parts = {
        "real": Part(real_strips, ("real_strips",)),
        "seams": Part(partial(seams, density=density), ("maps",)),
        "peers": Part(partial(beside_others, density=density), ("peers", "verde_grid")),
    }
    large = {
        f"made_{km2:g}_{density:g}": Part(partial(made_survey, km2=km2, density=density), ("maps",))
        for km2 in sizes_km2
    }
    if quick:
        return parts | large
    interrupted = ("interrupted", "kills")
    return {
        **parts,
        "coverage": Part(partial(small_surveys, density=density), ("small_surveys", "maps")),
        "kills": Part(killed_runs, interrupted),
        "scheduler": Part(lost_scheduler, interrupted),
        "rasters": Part(streamed, ("rasters",)),
        "plans": Part(planned, ("planning",)),
        **large,
        "workers": Part(partial(second_worker, density=density), interrupted),
    }


def run() -> None:
    """Run the benchmark from the command line."""
    parser = argparse.ArgumentParser(add_help=False)
    parser.add_argument("--km2", type=float, nargs="+", default=[1.0, 5.0, 25.0])
    parser.add_argument("--density", type=float, default=2.9)
    parser.add_argument("--part", nargs="+", default=[])
    chosen, rest = parser.parse_known_args()
    measure = partial(rows, chosen.km2, chosen.density, chosen.part)
    main("whole glacier", measure, arguments=rest, is_complete=not chosen.part)


if __name__ == "__main__":
    run()
