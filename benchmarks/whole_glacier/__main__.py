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

from benchmarks.report import Row, main
from benchmarks.stored_parts import parts_folder, stored_rows
from benchmarks.whole_glacier.interrupted import killed_runs, lost_scheduler, second_worker
from benchmarks.whole_glacier.maps import coverage, exponent, made_survey, real_strips, seams
from benchmarks.whole_glacier.peers import beside_gdal
from benchmarks.whole_glacier.planning import planned
from benchmarks.whole_glacier.rasters import streamed

Part = Callable[[Path], Iterable[Row]]


def rows(sizes_km2: list[float], density: float, only: list[str], quick: bool) -> Iterator[Row]:
    """Yield the rows of all parts, or of some."""
    place = parts_folder(
        "whole-glacier",
        "survey/reconstruction/tiled",
        "survey/reconstruction/lattice",
        "benchmarks/whole_glacier",
    )
    sizes = sizes_km2[:1] if quick else sizes_km2
    parts = _parts(sizes, density, quick=quick)
    found: list[Row] = []
    for name in only or parts:
        with tempfile.TemporaryDirectory(prefix="firnline-tiles-") as folder:
            own = stored_rows(place / f"{name}.json", partial(parts[name], Path(folder)))
        found += own
        yield from own
    yield from exponent(found)


def _parts(sizes_km2: list[float], density: float, *, quick: bool) -> dict[str, Part]:
    """Return the parts by name, the long ones last; few of them where it must be quick."""
    parts: dict[str, Part] = {"real": real_strips, "seams": partial(seams, density=density)}
    parts["peers"] = partial(beside_gdal, density=density)
    large: dict[str, Part] = {
        f"made_{km2:g}_{density:g}": partial(made_survey, km2=km2, density=density) for km2 in sizes_km2
    }
    if quick:
        return parts | large
    parts |= {
        "coverage": partial(coverage, density=density),
        "kills": killed_runs,
        "scheduler": lost_scheduler,
    }
    parts |= {"rasters": streamed, "plans": planned}
    return parts | large | {"workers": partial(second_worker, density=density)}


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
