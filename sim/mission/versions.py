"""Versions of the packages that compute results, compared when a run or a study is resumed."""

import platform
from collections.abc import Mapping
from importlib.metadata import PackageNotFoundError, version
from typing import Any

from survey.core.errors import InputError

_COMPUTING = (
    "firnline",
    "numpy",
    "scipy",
    "numba",
    "finufft",
    "gtsam",
    "opencv-python-headless",
    "mujoco",
    "pybullet",
    "rasterio",
    "pyproj",
    "shapely",
    "scikit-image",
    "scikit-learn",
)


def current_versions() -> dict[str, str]:
    """Return the versions of Python and of the installed packages that compute results.

    Returns
    -------
    dict
        Version by package. Of Python the patch number is left out; packages that only draw, store
        or read settings are not listed, so that their updates disturb no run.
    """
    found = {"python": ".".join(platform.python_version_tuple()[:2])}
    for name in _COMPUTING:
        try:
            found[name] = version(name)
        except PackageNotFoundError:  # one of the physics engines suffices
            continue
    return found


def refuse_other_versions(before: Mapping[str, Any], where: str, remedy: str) -> None:
    """Refuse to continue results that other versions have begun.

    Parameters
    ----------
    before : mapping of str to Any
        Versions of `current_versions` when the results were begun.
    where : str
        The results, for the message.
    remedy : str
        What to do instead, for the message.

    Raises
    ------
    InputError
        Names the packages that differ, both versions and the remedy.
    """
    now = current_versions()
    changes = [
        f"{name} {before.get(name) or 'not installed'} (now {now.get(name) or 'not installed'})"
        for name in dict.fromkeys([*before, *now])
        if before.get(name) != now.get(name)
    ]
    if changes:
        raise InputError(
            f"{where} was begun with {', '.join(changes)}, and a mixture of versions may give other bytes; {remedy}."
        )
