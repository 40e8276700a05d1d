"""Synthetic terrain from random fields, by name of their family."""

from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np

from survey.core.errors import ConfigError
from survey.data.dem import Dem
from survey.data.grid import Grid
from survey.terrain.landforms import cosine_surface, diamond_square, gaussian_hills, slope_and_waves
from survey.terrain.random_fields import (
    fractional_brownian,
    matern_field,
    squared_exponential_field,
)

_FAMILIES: dict[str, Callable[..., Dem]] = {
    "squared-exponential": squared_exponential_field,
    "matern-3/2": partial(matern_field, nu=1.5),
    "matern-5/2": partial(matern_field, nu=2.5),
    "gaussian_hills": gaussian_hills,
    "cosine_surface": cosine_surface,
    "diamond_square": diamond_square,
    "fractional_brownian": fractional_brownian,
    "slope_and_waves": slope_and_waves,
}


def random_dem(
    family: str, grid: Grid, rng: np.random.Generator, relief_m: float = 25.0, **parameters: Any
) -> Dem:
    """Draw terrain of a named family.

    Parameters
    ----------
    family : str
        ``squared-exponential``, ``matern-3/2``, ``matern-5/2``, ``gaussian_hills``,
        ``cosine_surface``, ``diamond_square``, ``fractional_brownian`` or ``slope_and_waves``.
    grid : Grid
        Where the heights are wanted.
    rng : numpy.random.Generator
        Source of the draws.
    relief_m : float
        Highest minus lowest node [m].
    **parameters
        Of that family's function, e.g. ``length_scale_m=220.0``.

    Returns
    -------
    Dem
        On the grid, above an unstated datum.

    Raises
    ------
    ConfigError
        An unknown family.
    InputError
        A parameter out of its range.

    Examples
    --------
    >>> grid = Grid((0.0, 0.0, 600.0, 600.0), 25.0)
    >>> random_dem("matern-5/2", grid, np.random.default_rng(1), length_scale_m=150.0).relief_m
    25.0
    """
    if family not in _FAMILIES:
        raise ConfigError(
            f"the terrain family {family!r} is not known; one of {', '.join(_FAMILIES)} was expected."
        )
    return _FAMILIES[family](grid, rng, relief_m=relief_m, **parameters)
