"""Grid points with verde, in an interpreter of its own: ``verde_grid.py POINTS.npy WEST NORTH COLUMNS ROWS METHOD OUT.npy``."""

import sys
from pathlib import Path

import numpy as np


def gridded(points: Path, west: float, north: float, shape: tuple[int, int], method: str) -> np.ndarray:
    """Return heights (rows, columns) [m] at the middles of cells of 1 m, the first row the northern one."""
    # Only the interpreter that runs this file has verde; the others may import it.
    import verde

    means, triangles = verde.BlockReduce(np.mean, spacing=1.0), verde.Linear()
    methods = {
        "block means and triangles": verde.Chain([("means", means), ("triangles", triangles)]),
        "ten nearest points": verde.KNeighbors(k=10),
    }
    x, y, z = np.load(points).T
    made = methods[method].fit((x, y), z)
    row, column = np.indices(shape) + 0.5
    return made.predict((west + column, north - row))


if __name__ == "__main__":
    source, west, north, columns, rows, method, out = sys.argv[1:]
    heights = gridded(Path(source), float(west), float(north), (int(rows), int(columns)), method)
    np.save(out, heights)
