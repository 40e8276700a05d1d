"""Commands of missions: ``init``, ``run``, ``simulate``, ``report`` and ``show``."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import typer

from firnline.actions.interface import DryRun, Json, RunOptions, Workers, end_dry_run, fact_line
from firnline.cli.outcome import NOT_MET, with_exit_codes
from firnline.cli.request import with_options_of


@with_exit_codes
def init(
    path: Annotated[Path, typer.Argument(help="The mission file to write.")] = Path("mission.toml"),
    dem: Annotated[
        Path | None,
        typer.Option("--dem", help="Survey this fine elevation raster instead of random terrain."),
    ] = None,
    force: Annotated[bool, typer.Option("--force", help="Replace an existing file.")] = False,
    dry_run: DryRun = False,
) -> None:
    """Write a mission file with every setting, its unit and its default.

    For example:

      firnline init my-survey.toml

      firnline init my-survey.toml --dem copernicus.tif
    """
    import numpy as np

    from firnline.actions.files import refuse_existing
    from sim.mission.template import mission_template
    from survey.core.files.links import resolved
    from survey.core.files.writing import replacing
    from survey.data.dem import Dem

    refuse_existing([path], force=force, inputs=[dem])
    has_voids = dem is not None and not np.isfinite(Dem.read(dem).elevation).all()
    if dry_run:
        end_dry_run([path])
    with replacing(resolved(path)) as draft:
        draft.write_text(mission_template(path.stem, dem, clip_to_terrain=has_voids), encoding="utf-8")
    ground = "random terrain" if dem is None else f"the ground of {dem}"
    typer.echo(f"{path} written: 4 swaths on {ground}; every other setting is explained and at its default")
    typer.echo(f"edit it, then run: firnline run {path}")


@dataclass(frozen=True, kw_only=True)
class RunRequest(RunOptions):
    """Options of the command."""

    mission: Annotated[Path, typer.Argument(help="Mission file (TOML).")]
    first: Annotated[
        str | None, typer.Option("--from", metavar="STAGE", help="Repeat this stage and all later ones.")
    ] = None
    until: Annotated[str, typer.Option("--until", metavar="STAGE", help="Stop after this stage.")] = "report"
    fresh: Annotated[bool, typer.Option("--fresh", help="Repeat every stage.")] = False
    require: Annotated[
        bool, typer.Option("--require", help="End with exit code 5 when the wanted class is not met.")
    ] = False
    workers: Workers = None


@with_exit_codes
@with_options_of(RunRequest)
def run(request: RunRequest) -> None:
    """Run a mission from plan to report, or continue it where it was stopped.

    Stages: plan, simulate, localize, reconstruct, score, report. The report's path is
    printed last.

    For example:

      firnline run examples/srtm_ridge.toml

      firnline run mine.toml --set planner.swaths=6 --require

      firnline run mine.toml --dry-run
    """
    from firnline.actions.missions import class_met, print_summary, run_until, summary
    from survey.core.errors import ConfigError
    from survey.core.runs.store import STAGES

    for stage in (request.first, request.until):
        if stage is not None and stage not in STAGES:
            raise ConfigError(f"there is no stage {stage!r}; the stages are {', '.join(STAGES)}.")
    start = "plan" if request.fresh else request.first
    done, folder = run_until(request.mission, request.until, request, first=start, workers=request.workers)
    print_summary(folder, as_json=request.as_json)
    if request.require and not class_met(summary(folder), done.score.require):
        raise typer.Exit(NOT_MET)


@dataclass(frozen=True, kw_only=True)
class SimulateRequest(RunOptions):
    """Options of the command."""

    mission: Annotated[Path, typer.Argument(help="Mission file (TOML).")]
    workers: Workers = None


@with_exit_codes
@with_options_of(SimulateRequest)
def simulate(request: SimulateRequest) -> None:
    """Plan and drive a mission: a recording for the estimator, the truth for scoring.

    For example:

      firnline simulate mine.toml --set fidelity=ideal
    """
    from firnline.actions.missions import print_summary, run_until

    _, folder = run_until(request.mission, "simulate", request, workers=request.workers)
    print_summary(folder, as_json=request.as_json)


@dataclass(frozen=True, kw_only=True)
class ReportRequest(RunOptions):
    """Options of the command."""

    source: Annotated[Path, typer.Argument(help="A run folder, or a mission file (TOML).")]


@with_exit_codes
@with_options_of(ReportRequest)
def report(request: ReportRequest) -> None:
    """Draw the report of a run again; a mission file is run first where it is not done yet.

    For example:

      firnline report results/runs/srtm-ridge/latest

      firnline report mine.toml
    """
    from firnline.actions.missions import print_summary, run_until
    from survey.core.errors import InputError
    from survey.core.runs.store import RunFolder

    if request.source.suffix == ".toml":
        _, run = run_until(request.source, "report", request)
    else:
        from sim.mission.report import write_mission_report

        run = RunFolder.find(request.source)
        if not run.has("score"):
            raise InputError(
                f"{run.path} is not scored yet, so there is nothing to report; finish it with firnline run."
            )
        for stage in ("plan", "simulate", "localize", "reconstruct", "score"):
            run.verify(stage)
        if request.dry_run:
            end_dry_run([run.folder("report")])
        with run.stage("report") as folder:
            write_mission_report(folder, run)
    print_summary(run, as_json=request.as_json)


@with_exit_codes
def show(
    run: Annotated[
        Path, typer.Argument(help="A run folder, a mission's folder of runs, or its latest link.")
    ],
    as_json: Json = False,
) -> None:
    """Show which stages of a run are done, how long they took, and the score.

    Every file is checked against the checksum that was taken when it was written.

    For example:

      firnline show results/runs/srtm-ridge
    """
    from firnline.actions.missions import print_summary
    from survey.core.runs.log import read_log
    from survey.core.runs.store import STAGES, RunFolder

    folder = RunFolder.find(run)
    done = [stage for stage in STAGES if folder.has(stage)]
    for stage in done:
        folder.verify(stage)
    if folder.log_file.exists():
        read_log(folder.log_file)
    if not as_json:
        missing = [stage for stage in STAGES if stage not in done]
        left = f"; open: {', '.join(missing)}" if missing else ""
        typer.echo(fact_line("done", f"{', '.join(done) or 'nothing'}{left}"))
    print_summary(folder, as_json=as_json)
