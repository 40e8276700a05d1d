"""The simulator: its images, then the rover's physics and instruments.

Run with ``python -m benchmarks.simulator``; the halves are `benchmarks.simulator_rendering`
and `benchmarks.simulator_physics`.
"""

from collections.abc import Iterator

from benchmarks import simulator_physics, simulator_rendering
from benchmarks.report import Row, main


def rows(quick: bool) -> Iterator[Row]:
    """Yield one row per claim."""
    yield from simulator_rendering.rows(quick)
    yield from simulator_physics.rows(quick)


if __name__ == "__main__":
    main("Simulator", rows, packages=("numpy", "scipy", "numba", "opencv-python-headless", "pybullet"))
