"""Commands of many runs: ``montecarlo``, ``rehearse`` and ``fit``."""

from pathlib import Path
from typing import Annotated

import typer

from firnline.actions.requests import MonteCarloRequest, RehearseRequest
from firnline.cli.outcome import with_exit_codes
from firnline.cli.request import DryRun, Json, Printing, Quiet, print_result, with_options_of


@with_exit_codes
@with_options_of(MonteCarloRequest)
def montecarlo(
    request: MonteCarloRequest, dry_run: DryRun = False, as_json: Json = False, quiet: Quiet = False
) -> None:
    """Survey many random terrains by several planners, and count the swaths that a map class takes.

    Trials are stored as they finish; the same command continues a stopped study.

    For example:

      firnline montecarlo examples/montecarlo_fig10.toml

      firnline montecarlo study.toml --set trials=1000 --scheduler tcp://10.0.0.5:8786
    """
    from firnline.actions import missions
    from firnline.cli.progress import counted

    if dry_run:
        print_result(missions.preview_montecarlo(request))
        return
    with counted(quiet=quiet) as progress:
        made = missions.montecarlo(request, progress)
    print_result(made, as_json=as_json)


@with_exit_codes
@with_options_of(RehearseRequest)
def rehearse(request: RehearseRequest, printing: Printing) -> None:
    """Run a mission many times with other seeds and drawn settings, and count how often it reaches its class.

    Outcomes are stored as they finish; the same command continues a stopped rehearsal, and a larger --count adds
    runs. fault_tree.png shows what the runs that missed it failed of.

    For example:

      firnline rehearse mine.toml --count 50

      firnline rehearse mine.toml --set fleet.loss_probability=0.1
    """
    from firnline.actions import missions
    from firnline.cli.progress import counted

    if printing.dry_run:
        print_result(missions.preview_rehearsal(request))
        return
    with counted(quiet=printing.quiet) as progress:
        made = missions.rehearse(request, progress)
    print_result(made.write(), as_json=printing.as_json)


@with_exit_codes
def fit(
    runs: Annotated[list[Path], typer.Argument(help="Run folders of missions in the vision fidelity.")],
) -> None:
    """Fit the sensor errors of the statistical fidelity to the errors of drives with images.

    Prints the section of a mission file; GPS and barometer are not touched. Fit to drives
    that nothing is judged on.

    For example:

      firnline fit results/runs/glacier-drive/latest > sensors.toml
    """
    from firnline.actions import missions

    typer.echo(missions.fit(runs), nl=False)
