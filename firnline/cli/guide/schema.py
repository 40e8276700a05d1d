"""``firnline schema``: print the JSON Schema of mission or study files."""

from typing import Annotated, Literal

import typer

from firnline.cli.outcome import with_exit_codes


@with_exit_codes
def schema(
    kind: Annotated[
        Literal["mission", "study"], typer.Argument(help="Kind of file: mission, or study (Monte Carlo).")
    ] = "mission",
) -> None:
    """Print the JSON Schema of a kind of file, by which editors complete and check it.

    A line #:schema mission.schema.json at the head of a TOML file, as init writes it, names the schema.

    For example:

      firnline schema mission > mission.schema.json

      firnline schema study > study.schema.json
    """
    import json

    from sim.config.mission import MissionConfig
    from sim.mission.runs import json_schema
    from sim.montecarlo.config import StudyConfig

    model = MissionConfig if kind == "mission" else StudyConfig
    typer.echo(json.dumps(json_schema(model, f"firnline {kind} file"), indent=2, ensure_ascii=False))
