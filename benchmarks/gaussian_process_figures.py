"""Cost of a map against the number of points and against the length scale, beside what arithmetic allows."""

from collections.abc import Callable

import matplotlib as mpl
import numpy as np

from benchmarks.gaussian_process_peers import Points
from benchmarks.report import cpu_seconds
from benchmarks.writer import TABLES
from survey.core.arrays import FloatArray
from survey.reconstruction.gp.engines.fourier_gp import FourierGaussianProcess
from survey.reconstruction.gp.kernels import SquaredExponential

mpl.use("Agg")

SIZES = (1000, 5000, 20_000, 100_000, 400_000)
LENGTHS_M = (13.0, 17.75, 25.0, 35.0, 50.0, 70.0)


def flop_rate() -> float:
    """Measured floating-point operations per second of a matrix product on one thread."""
    a = np.random.default_rng(0).standard_normal((2000, 2000))
    _ = a @ a
    _, seconds = cpu_seconds(lambda: a @ a)
    return 2 * 2000**3 / seconds


def cost_figure(
    points_of: Callable[[int], Points], fit: Callable[..., FourierGaussianProcess], axis: FloatArray
) -> None:
    """Measure and draw both panels, and save them with the results."""
    import matplotlib.pyplot as plt

    rate = flop_rate()
    figure, panels = plt.subplots(1, 2, figsize=(9, 3.6), constrained_layout=True, sharey=True)
    by_size = [_cost(points_of(n), SquaredExponential(10.0, 17.75), fit, axis) for n in SIZES]
    by_length = [_cost(points_of(5000), SquaredExponential(10.0, length), fit, axis) for length in LENGTHS_M]
    for panel, places, costs, label in (
        (panels[0], SIZES, by_size, "points"),
        (panels[1], LENGTHS_M, by_length, "length scale [m]"),
    ):
        seconds, modes = (np.array(column, dtype=float) for column in zip(*costs, strict=True))
        panel.loglog(places, seconds, "o-", label="measured")
        panel.loglog(places, modes**3 / rate, "k--", label="modes³ at the rate of a matrix product")
        panel.set_xlabel(label)
        panel.grid(alpha=0.3, which="both")
    panels[0].set_ylabel("mean and std on 601 × 601 [CPU s]")
    panels[0].legend()
    TABLES.mkdir(parents=True, exist_ok=True)
    figure.savefig(TABLES / "gaussian_process_cost.png", dpi=120, metadata={"Software": None})
    plt.close(figure)


def _cost(
    points: Points, kernel: SquaredExponential, fit: Callable[..., FourierGaussianProcess], axis: FloatArray
) -> tuple[float, int]:
    """CPU seconds of one map, and its number of modes."""

    def work() -> int:
        gp = fit(*points, kernel, bounds=(axis[0], axis[0], axis[-1], axis[-1]), memory_mb=600)
        gp.predict_on_axes(axis, axis)
        return gp.resolution.n_modes

    n_modes, seconds = cpu_seconds(work)
    return seconds, n_modes
