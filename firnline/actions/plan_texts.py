"""Texts of what is expected of a route: length, time, energy, error of the map and its level."""

from collections.abc import Callable, Mapping
from functools import partial

from survey.core import duration_text, energy_text, length_text


def fact_texts(prediction: Mapping[str, float]) -> dict[str, tuple[str, str]]:
    """Return title and text of each number that is expected of a route, by its name."""
    texts: dict[str, tuple[str, Callable[[float], str]]] = {
        "length_m": ("length", length_text),
        "n_turns": ("turns", "{:.0f}".format),
        "time_s": ("time", duration_text),
        "energy_j": ("energy", energy_text),
        "n_recharges": ("recharges", "{:.0f}".format),
        "transit_share": ("transit", "{:.1%} of the swaths' length".format),
        "left_out_share": ("left out", "{:.1%} of the area".format),
        "rmse_m": ("predicted RMSE", partial(_error_text, prediction)),
        _LEVEL: ("level of the map", partial(_level_text, prediction)),
        "map_scale": ("scale of the CRS", "{:.6f}".format),
        "prior_covered_share": ("prior", "covers {:.1%} of the area".format),
    }
    rows = {}
    for name, value in prediction.items():
        if name in _WITHIN or (name.endswith("_level_m") and name != _LEVEL):
            continue  # part of the texts of the RMSE and of the level
        title, text = texts.get(name, (name.replace("_", " ").removesuffix(" m"), "{:.4g}".format))
        if name.startswith("wait_s_rover_"):
            title, text = f"rover {int(name.rsplit('_', 1)[1]) + 1} departs after", duration_text
        rows[name] = (title, text(value))
    return rows


def _error_text(prediction: Mapping[str, float], rmse_m: float) -> str:
    """Return the expected error with the bounds that it lies between with 80 %."""
    if "rmse_low_m" not in prediction:
        return f"{rmse_m:.2f} m"
    return f"{rmse_m:.2f} m ({prediction['rmse_low_m']:.2f} to {prediction['rmse_high_m']:.2f} m with 80 %)"


_LEVEL, _WITHIN = "prior_level_m", ("rmse_low_m", "rmse_high_m", "shared_m", "prior_level_share")


def _level_text(prediction: Mapping[str, float], prior_level_m: float) -> str:
    """Return what errors of the level make of the error of a planned map."""
    rmse_m = {
        name.removeprefix("rmse_").removesuffix("_level_m"): value
        for name, value in prediction.items()
        if name.endswith("_level_m")
    }
    return level_text(prediction["shared_m"], prior_level_m, prediction["prior_level_share"], rmse_m)


def level_text(shared_m: float, prior_level_m: float, share: float, rmse_m: Mapping[str, float]) -> str:
    """Return how much of a map's error its level is, and what known heights change.

    `shared_m`, `prior_level_m`: standard deviation of the level by the samples, and by the prior alone [m]. `share`: that of
    the latter in the squared error. `rmse_m`: error of the map by what holds its level: "prior" and `TIES`.

    >>> print(level_text(0.05, 1.2, 0.64, {"prior": 1.5, "checkpoint": 1.1, "stake": 0.9, "benchmark": 0.9})[:93])
    ± 0.05 m where samples have heights of their own (--shared); by the prior alone ± 1.20 m, 64%
    """
    from survey.reconstruction.level import TIES  # loads what help does not need

    ties = ", ".join(f"{rmse_m[name]:.2f} m with {tie.name}" for name, tie in TIES.items())
    return (
        f"± {shared_m:.2f} m where samples have heights of their own (--shared); by the prior alone ± {prior_level_m:.2f} m, "
        f"{share:.0%} of the squared error: RMSE {rmse_m['prior']:.2f} m, {ties}"
    )
