"""``firnline doctor``: check the installation and what the demos need."""

import typer

from firnline.cli.options import Json
from firnline.cli.outcome import with_exit_codes


@with_exit_codes
def doctor(as_json: Json = False) -> None:
    """Check the installation and the machine, and state what will not run.

    Packages, physics engine, memory, disk, threads, fonts, caches, transformation grids. The exit code is 1 where
    something will not run.

    For example:

      firnline doctor
    """
    import json

    from firnline.cli.diagnosis.machine import library_findings, machine_findings
    from firnline.cli.diagnosis.packages import extra_findings, package_findings, physics_finding

    findings = [*package_findings(), physics_finding(), *extra_findings()]
    findings += [*machine_findings(), *library_findings()]
    if as_json:
        rows = [
            {"what": f.what, "found": f.found, "well": f.is_well, "prevents": f.prevents} for f in findings
        ]
        typer.echo(json.dumps(rows, indent=2))
    else:
        for finding in findings:
            typer.echo(f"{'ok  ' if finding.is_well else 'LOOK'}  {finding.what:<24} {finding.found}")
        lost = dict.fromkeys(f.prevents for f in findings if not f.is_well)
        typer.echo(f"will not run: {'; '.join(lost)}" if lost else "both demos will run (make demo)")
    if not all(finding.is_well for finding in findings):
        raise typer.Exit(1)
