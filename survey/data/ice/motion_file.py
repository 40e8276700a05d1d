"""File of an estimate of the ice's motion."""

from pathlib import Path

import numpy as np

from survey.core.documents import read_json, write_json
from survey.core.errors import InputError
from survey.data.ice.motion import IceMotion

ICE_MOTION = "ice_motion.json"
"""Name of the file beside a path or a map."""
_FORMAT = "firnline-ice-motion-1"


def write_motion(motion: IceMotion, path: str | Path) -> None:
    """Write a motion as a JSON document, with its rates at the origin.

    Parameters
    ----------
    motion : IceMotion
        Estimate.
    path : str or pathlib.Path
        The file.
    """
    at_origin = motion.origin_m[None]
    names = ("velocity_east", "velocity_north", "rise")
    rates, sigma = motion.rates(at_origin)[0].tolist(), motion.rates_sigma(at_origin)[0].tolist()
    content = {
        "format": _FORMAT,
        "epoch_s": motion.epoch_s,
        "origin_m": motion.origin_m.tolist(),
        **{f"{name}_m_per_day": value for name, value in zip(names, rates, strict=True)},
        **{f"{name}_sigma_m_per_day": value for name, value in zip(names, sigma, strict=True)},
        "coefficients": motion.coefficients.tolist(),
        "modes": motion.modes.tolist(),
        "spread": motion.spread.tolist(),
        "expected": motion.expected.tolist(),
    }
    write_json(path, content)


def read_motion(path: str | Path) -> IceMotion:
    """Read the document of `write_motion`.

    Parameters
    ----------
    path : str or pathlib.Path
        The file.

    Returns
    -------
    IceMotion
        Equal to the one written.

    Raises
    ------
    InputError
        The file is missing or damaged.
    """
    content = read_json(path, "the motion of the ice")
    try:
        coefficients = np.array(content["coefficients"], dtype=np.float64)
        expected = np.array(content["expected"], dtype=np.float64)
        modes = np.array(content["modes"], dtype=np.float64).reshape(coefficients.size, len(expected))
        spread = np.array(content["spread"], dtype=np.float64).reshape(len(expected), len(expected))
        epoch_s, origin_m = float(content["epoch_s"]), np.array(content["origin_m"], dtype=np.float64)
    except (KeyError, TypeError, ValueError) as error:
        raise InputError(f"{path} is no motion of the ice ({error}); localize again.") from error
    return IceMotion(coefficients, epoch_s, origin_m, modes, spread, expected)
