"""Checks of the installed packages, the optional ones and the physics engine."""

import platform
from importlib.metadata import PackageNotFoundError, requires, version
from importlib.util import find_spec

from packaging.requirements import Requirement

from firnline.cli.diagnosis.findings import Finding

# Modules of the optional extras, with what needs them.
_EXTRAS = {
    "rosbags": ("bags", "ROS bags are not read"),
    "h5netcdf": ("netcdf", "NetCDF maps are not written"),
    "xarray": ("notebook", "to_xarray is not available"),
    "distributed": ("cluster", "Monte Carlo studies run on this machine alone"),
}
_EVERYTHING = "firnline"


def package_findings() -> list[Finding]:
    """Check the required packages by their versions."""
    rows = [Finding("Python", platform.python_version())]
    for line in requires("firnline") or []:
        requirement = Requirement(line)
        if requirement.marker is None or requirement.marker.evaluate({"extra": ""}):
            rows.append(_required(requirement))
    return rows


def _required(requirement: Requirement) -> Finding:
    name = requirement.name
    try:
        found = version(name)
    except PackageNotFoundError:
        return Finding(name, "missing; install firnline again", is_well=False, prevents=_EVERYTHING)
    if requirement.specifier.contains(found, prereleases=True):
        return Finding(name, found)
    wanted = f"{found}, and {requirement.specifier} is needed; install firnline again"
    return Finding(name, wanted, is_well=False, prevents=_EVERYTHING)


def extra_findings() -> list[Finding]:
    """State which optional packages are there; none is a fault."""
    return [
        Finding(module, "installed" if find_spec(module) else f"not installed: {lost} (pip install 'firnline[{extra}]')")
        for module, (extra, lost) in _EXTRAS.items()
    ]  # fmt: skip


def physics_finding() -> Finding:
    """Check whether a rigid-body engine can be imported."""
    from sim.vehicle.rigid_bodies import choose_engine
    from survey.core.errors import ConfigError

    try:
        return Finding("physics engine", choose_engine("contact"))
    except ConfigError as error:
        return Finding(
            "physics engine",
            str(error),
            is_well=False,
            prevents="the second demo (short_drive) and other drives of the fidelity vision",
        )
