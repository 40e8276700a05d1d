"""``firnline fit``: fit the error model of the statistical fidelity to drives with images."""

from pathlib import Path
from typing import Annotated

import typer

from firnline.cli.outcome import with_exit_codes


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
    import tomlkit

    from sim.config.mission import SensorConfig
    from sim.simulate.error_model import errors_of, fit_sensor_errors
    from survey.core.run_folder import RunFolder

    found = fit_sensor_errors([errors_of(RunFolder.find(run)) for run in runs]).model_dump(mode="json")
    usual = SensorConfig().model_dump(mode="json")
    changed = {name: value for name, value in found.items() if value != usual[name]}
    typer.echo(tomlkit.dumps({"sensors": changed}), nl=False)
