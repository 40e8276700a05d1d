"""Errors that last a while: first-order Gauss–Markov series."""

import numpy as np

from survey.core.arrays import FloatArray


def gauss_markov(
    steps: FloatArray, correlation: float, sigma: float, rng: np.random.Generator, n_columns: int = 1
) -> FloatArray:
    """Draw stationary first-order Gauss–Markov series (len(steps) + 1, n_columns) with standard deviation sigma."""
    memory = np.exp(-steps / correlation)
    noise = rng.standard_normal((len(steps) + 1, n_columns)) * sigma
    if len(memory) and np.allclose(memory, memory[0], rtol=1e-12):
        a = float(memory[0])
        noise[1:] *= np.sqrt(1.0 - a * a)
        from scipy.signal import lfilter  # slow to import, and most of what is simulated needs none

        series: FloatArray = lfilter([1.0], [1.0, -a], noise, axis=0)
        return series
    for k, a in enumerate(memory):
        noise[k + 1] = a * noise[k] + np.sqrt(1.0 - a * a) * noise[k + 1]
    return noise
