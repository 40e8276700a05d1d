"""``firnline doctor``: check the installation."""

import typer

from sim.cli.options import Json
from sim.cli.outcome import with_exit_codes


@with_exit_codes
def doctor(as_json: Json = False) -> None:
    """Check the installation: packages, transformation grids, memory, write access.

    For example:

      firnline doctor
    """
    import json

    findings = [*_packages(), *_machine()]
    if as_json:
        typer.echo(json.dumps([{"what": w, "found": f, "well": ok} for w, f, ok in findings], indent=2))
    else:
        for what, found, well in findings:
            typer.echo(f"{'ok  ' if well else 'LOOK'}  {what:<24} {found}")
    if not all(well for _, _, well in findings):
        raise typer.Exit(1)


Finding = tuple[str, str, bool]


def _packages() -> list[Finding]:
    import platform
    from importlib.metadata import PackageNotFoundError, requires, version

    from packaging.requirements import Requirement

    rows: list[Finding] = [("Python", platform.python_version(), True)]
    for line in requires("firnline") or []:
        requirement = Requirement(line)
        if requirement.marker is not None and not requirement.marker.evaluate({"extra": ""}):
            continue
        try:
            found = version(requirement.name)
            rows.append((requirement.name, found, requirement.specifier.contains(found, prereleases=True)))
        except PackageNotFoundError:
            rows.append((requirement.name, "missing; install firnline again", False))
    return rows


def _machine() -> list[Finding]:
    import os

    import pyproj
    import rasterio

    memory_gib = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") / 2**30
    return [
        ("cores", str(os.cpu_count()), True),
        ("memory", f"{memory_gib:.0f} GiB", memory_gib >= 2.0),
        ("GDAL", rasterio.__gdal_version__, True),
        ("PROJ", pyproj.proj_version_str, True),
        *_geoids(),
        (
            "this folder",
            "can be written to" if os.access(".", os.W_OK) else "is read-only; runs need --runs",
            True,
        ),
    ]


def _geoids() -> list[Finding]:
    """Check for each vertical datum whether heights can be transformed to it, and which of PROJ's grids are missing."""
    from survey.core.crs.transformation import lacking_grids

    return [
        (
            datum,
            f"no grid: {', '.join(missing)}; heights stay in the datum of their file"
            if missing
            else "grid is here",
            True,
        )
        for datum, missing in lacking_grids().items()
    ]
