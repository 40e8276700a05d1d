"""Three rovers in images on eight swaths of 600 m: the complete chain from the plan to the report.

Run with ``python -m benchmarks.fleet_in_images``; it takes about an hour of CPU time. The drive of each rover is stored
when it is done (``FIRNLINE_FLEET_IMAGES`` names the folder), and a run that was broken off continues with the next one.
``--quick`` drives three swaths of 60 m, as `benchmarks.fleet` does. Nothing is chosen by this mission; melt channels and
dirt cones were taken off the ground after a first run, in which a rover got stuck in a channel. Rovers are driven
one after another in one process, so the pace of two cores follows from the CPU time; rovers of a mission drive side by
side in processes to the same bytes.
"""

import os
import tempfile
from collections.abc import Iterator
from pathlib import Path

from benchmarks.fleet.image_missions import SHORT, WHOLE, rows
from benchmarks.report import Row, main
from benchmarks.stored_parts import code_digest

SEED = 7101
_SOURCES = ("survey", "planners", "vision_slam", "sim", "benchmarks/fleet/image_missions.py")


def measure(quick: bool) -> Iterator[Row]:
    """Yield the rows."""
    named = os.environ.get("FIRNLINE_FLEET_IMAGES")
    folder = Path(named or tempfile.gettempdir()) / f"firnline-fleet-images-{code_digest(_SOURCES)}"
    yield from rows(SEED, SHORT if quick else WHOLE, folder)


if __name__ == "__main__":
    main("Fleet in images", measure, ("numpy", "scipy", "numba", "opencv-python-headless"))
