"""Live surveys: missions over lossy links, kills, malformed telemetry, the live map, and the closed loop.

``python -m benchmarks.live [--quick] [--json FILE]``

The closed loop runs on random sites of seeds that nothing was chosen on, with the rover in a process of its own. Times of uploads are wall time, which other users of the machine lengthen. Parts are stored as they
finish, in the folder FIRNLINE_LIVE_PARTS, and an ended run goes on from them.
"""

import os
import tempfile
from collections.abc import Iterator
from pathlib import Path

from benchmarks.live.closed_loop import loop_rows
from benchmarks.live.fuzz import fuzz_rows
from benchmarks.live.links import kill_rows, loss_rows, transfer_rows
from benchmarks.live.map_update import map_rows
from benchmarks.report import Row, main
from benchmarks.stored_parts import stored_rows

_PARTS = {
    "transfers": transfer_rows,
    "losses": loss_rows,
    "kills": kill_rows,
    "fuzz": fuzz_rows,
    "map": map_rows,
    "loop": loop_rows,
}


def measure(quick: bool) -> Iterator[Row]:
    """Yield the rows."""
    folder = Path(os.environ.get("FIRNLINE_LIVE_PARTS", Path(tempfile.gettempdir()) / "firnline-live"))
    for name, make in _PARTS.items():
        if quick:
            yield from make(True)
        else:
            yield from stored_rows(folder / f"{name}.json", lambda make=make: make(False))


if __name__ == "__main__":
    main("Live surveys", measure, ("numpy", "scipy", "mavsdk", "pymavlink"))
