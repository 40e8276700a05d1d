"""Run the stages of missions, draw their reports, and summarize them."""

import logging
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, nullcontext, suppress
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np

from firnline.actions.interface import (
    Preview,
    Result,
    WrittenResult,
    fact_line,
    previewed_by,
    refuse_existing,
)
from firnline.actions.requests import InitRequest, ReportRequest, RunOptions, RunRequest
from firnline.actions.scoring import best_class, class_met
from sim.mission.runs import mission_template, open_run, planned_place, read_mission
from sim.mission.stages import StageContext, run_mission
from sim.world.site import SharedWorld
from survey import ConfigError, Dem, InputError, Reconstruction
from survey.core import read_json, replacing
from survey.core.documents import cut_incomplete_line, log_line, read_log
from survey.core.replacement import resolved
from survey.core.run_folder import STAGES, RunFolder

Watch = Callable[[Mapping[str, float]], StageContext]
"""Called with the seconds that stages took before; returns the context in which each stage runs."""
SERVED_FILE = "served.json"
"""What was sent and received on a served drive."""
_PACKAGES = ("survey", "planners", "vision_slam", "sim", "live", "desk", "papers", "firnline")


@dataclass(frozen=True)
class MissionTemplate(WrittenResult):
    """Mission file with every setting, its unit and its default.

    Parameters
    ----------
    request : InitRequest
        The file, and the terrain.
    text : str
        Content of the file.
    """

    request: InitRequest
    text: str

    def _request_at(self, out: Path) -> InitRequest:
        return replace(self.request, path=out)

    def _write_files(self) -> None:
        """Write the file."""
        with replacing(resolved(self.request.path)) as draft:
            draft.write_text(self.text, encoding="utf-8")

    def lines(self) -> list[str]:
        """Return what was written, and the next step."""
        path, dem = self.request.path, self.request.dem
        ground = "random terrain" if dem is None else f"the ground of {dem}"
        return [
            f"{path} written: 4 swaths on {ground}; every other setting is explained and at its default",
            f"edit it, then run: firnline run {path}",
        ]


def init(request: InitRequest) -> MissionTemplate:
    """Return a mission file with every setting, its unit and its default.

    Parameters
    ----------
    request : InitRequest
        The file, and the terrain.

    Returns
    -------
    MissionTemplate
        The file; `MissionTemplate.write` writes it.

    Raises
    ------
    InputError
        A file that exists, or a raster that cannot be read.
    """
    refuse_existing([request.path], force=request.force, inputs=[request.dem])
    has_voids = request.dem is not None and not np.isfinite(Dem.read(request.dem).elevation).all()
    return MissionTemplate(
        request, mission_template(request.path.stem, request.dem, clip_to_terrain=has_voids)
    )


@dataclass(frozen=True)
class RunResult(Result):
    """Run of a mission, whose files are in its folder.

    Parameters
    ----------
    run : RunFolder
        The run.
    wanted : str, optional
        Class that the map has to meet.
    heading : tuple of str
        Lines before the summary.
    """

    run: RunFolder
    wanted: str | None = None
    heading: tuple[str, ...] = ()

    @property
    def is_met(self) -> bool:
        """Whether the map meets the wanted class, or none is wanted."""
        return self.wanted is None or class_met(self.facts(), self.wanted)

    def facts(self) -> dict[str, Any]:
        """Return folder, stage times, drives and score."""
        return summary(self.run)

    def lines(self) -> list[str]:
        """Return times, drives, error, class, and the place of the report."""
        content = self.facts()
        seconds = {name: each or 0.0 for name, each in content["stage_wall_s"].items()}
        times = ", ".join(f"{name} {each:.1f} s" for name, each in seconds.items())
        lines = [*self.heading, fact_line("stages", f"{times} (together {sum(seconds.values()):.1f} s)")]
        lines += _drive_lines(content)
        if "score" in content:
            lines.append(fact_line("RMSE", f"{content['score']['elevation']['rmse_m']:.3f} m"))
            lines.append(fact_line("class", best_class(content["score"])))
            if self.wanted is not None:
                lines.append(fact_line("required", f"{self.wanted}, {'met' if self.is_met else 'not met'}"))
        lines += [fact_line("map", sentence) for sentence in content.get("own_claim", [])]
        end = "report" if "report" in content else "run"
        return [*lines, fact_line(end, content[end])]


def unwatched(seconds: Mapping[str, float]) -> StageContext:
    """Return a context that shows nothing."""
    del seconds
    return nullcontext


def preview_run(request: RunRequest) -> Preview:
    """Check a mission and its input, and return where it would run and which stages are to be done."""
    return preview_stages(request.mission, request, first=_first(request), until=request.until)


@previewed_by(preview_run)
def run(request: RunRequest, watch: Watch = unwatched, *, verbose: int | None = None) -> RunResult:
    """Run a mission from plan to report, or continue it.

    Parameters
    ----------
    request : RunRequest
        Mission, stages and settings.
    watch : callable
        Called with the seconds that stages took before; returns the context of each stage.
    verbose : int, optional
        Echo warnings on stderr, and above 0 all records of the log; none by default.

    Returns
    -------
    RunResult
        The run.

    Raises
    ------
    InputError
        What a stage refuses.
    ConfigError
        An unknown stage, or a setting that is unknown or wrong.
    """
    made = run_until(
        request.mission,
        request.until,
        request,
        first=_first(request),
        workers=request.workers,
        watch=watch,
        verbose=verbose,
    )
    return made if request.require else replace(made, wanted=None)


def _first(request: RunRequest) -> str | None:
    """Return the stage to begin with; refuse stages that do not exist."""
    for stage in (request.first, request.until):
        if stage is not None and stage not in STAGES:
            raise ConfigError(f"there is no stage {stage!r}; the stages are {', '.join(STAGES)}.")
    return "plan" if request.fresh else request.first


def run_until(
    mission_file: Path,
    stage: str,
    options: RunOptions,
    *,
    first: str | None = None,
    workers: int | None = None,
    watch: Watch = unwatched,
    verbose: int | None = None,
) -> RunResult:
    """Run the stages of a mission that are not done yet, or all from `first` on, up to a stage."""
    mission = read_mission(mission_file, options.settings)
    world = SharedWorld(mission)
    run = open_run(mission, options.runs, first=first, world=world)
    with logged_to(run.log_file, verbose):
        shown = watch(earlier_seconds(run))
        run_mission(mission, run, until=stage, watch=shown, workers=workers, world=world)
    return RunResult(run, mission.score.require)


def preview_report(request: ReportRequest) -> Preview:
    """Check a run or a mission, and return where its report would be written."""
    if request.source.suffix == ".toml":
        return preview_stages(request.source, request)
    return Preview.of([_scored_run(request.source).folder("report")])


@previewed_by(preview_report)
def report(request: ReportRequest, watch: Watch = unwatched, *, verbose: int | None = None) -> RunResult:
    """Draw the report of a run again; a mission file is run first where it is not done yet.

    Parameters
    ----------
    request : ReportRequest
        Run folder or mission file.
    watch : callable
        As for `run`.
    verbose : int, optional
        As for `run`.

    Returns
    -------
    RunResult
        The run.

    Raises
    ------
    InputError
        A run without a score.
    """
    if request.source.suffix != ".toml":
        found = _scored_run(request.source)
    elif request.is_usual:
        return replace(
            run_until(request.source, "report", request, watch=watch, verbose=verbose), wanted=None
        )
    else:
        found = run_until(request.source, "score", request, watch=watch, verbose=verbose).run
    from sim.mission.report import write_mission_report

    with found.stage("report") as folder:
        write_mission_report(folder, found, request.form, request.field_work(found.folder("plan")))
    return RunResult(found)


def _scored_run(source: Path) -> RunFolder:
    """Return a run with a score, whose files are as they were written."""
    found = RunFolder.find(source)
    if not found.has("score"):
        raise InputError(
            f"{found.path} is not scored yet, so there is nothing to report; finish it with firnline run."
        )
    for stage in ("plan", "simulate", "localize", "reconstruct", "score"):
        found.verify(stage)
    return found


def show(source: Path) -> RunResult:
    """Check every file of a run against its checksum, and return its stages and results.

    Parameters
    ----------
    source : pathlib.Path
        A run folder, a mission's folder of runs, or its latest link.

    Returns
    -------
    RunResult
        The run.

    Raises
    ------
    InputError
        No run, or one whose files were changed.
    """
    found = RunFolder.find(source)
    done = [stage for stage in STAGES if found.has(stage)]
    for stage in done:
        found.verify(stage)
    if found.log_file.exists():
        read_log(found.log_file)
    missing = [stage for stage in STAGES if stage not in done]
    left = f"; open: {', '.join(missing)}" if missing else ""
    return RunResult(found, heading=(fact_line("done", f"{', '.join(done) or 'nothing'}{left}"),))


def earlier_seconds(run: RunFolder) -> dict[str, float]:
    """Return how long each stage took in other runs of the same mission, the latest that did it [s]."""
    seconds: dict[str, float] = {}
    others = [file for file in run.path.parent.glob("*/manifest.json") if not file.parent.is_symlink()]
    for file in sorted(others, key=lambda file: file.stat().st_mtime):
        if file.parent == run.path:
            continue
        with suppress(InputError):  # damaged runs are refused when they are opened themselves
            stages = RunFolder(file.parent).manifest["stages"]
            seconds |= {name: float(entry["wall_s"]) for name, entry in stages.items() if entry["wall_s"]}
    return seconds


def preview_stages(
    mission_file: Path, options: RunOptions, *, first: str | None = None, until: str = "report"
) -> Preview:
    """Check a mission and its input, and return where it would run and which stages are to be done."""
    mission = read_mission(mission_file, options.settings)
    place = planned_place(mission, options.runs)
    done = set()
    if (place / "manifest.json").exists() and first != "plan":
        run = RunFolder(place)
        done = {stage for stage in STAGES if run.has(stage)}
    if first is not None:
        done -= set(STAGES[STAGES.index(first) :])
    stages = STAGES[: STAGES.index(until) + 1]
    facts = {
        "run": f"{place}{'' if place.exists() else ' (new)'}",
        "done": ", ".join(stage for stage in stages if stage in done) or "nothing",
        "to do": ", ".join(stage for stage in stages if stage not in done) or "nothing",
    }
    return Preview.of([place], facts)


def summary(run: RunFolder) -> dict[str, Any]:
    """Return folder and stage times of a run, and its score where there is one."""
    stages = {name: entry["wall_s"] for name, entry in run.manifest["stages"].items()}
    content: dict[str, Any] = {"run": str(run.path), "stage_wall_s": stages}
    if run.has("simulate"):
        content |= _driven(run.folder("simulate"))
        if (served := run.folder("simulate") / SERVED_FILE).exists():
            content["served"] = read_json(served, "the account of a served drive")
    if run.has("reconstruct"):
        content["own_claim"] = _own_claim(run.folder("reconstruct"))
    if run.has("score"):
        content["score"] = read_json(run.folder("score") / "score.json", "the score")
    if run.has("report"):
        content["report"] = str(run.folder("report") / "index.html")
    return content


def _driven(folder: Path) -> dict[str, Any]:
    """Return how the drive ended, or that of each rover of a fleet, and what losses cost."""
    from sim.mission.fleet import LOSS_FILE, accounts, drive_folders
    from sim.simulate.simulated_drive import DRIVE_FILE

    if drive_folders(folder) != [folder]:
        content: dict[str, Any] = {"drives": accounts(folder)}
        losses = folder / LOSS_FILE
        return content | ({"losses": read_json(losses, "the losses")} if losses.exists() else {})
    if not (folder / DRIVE_FILE).exists():
        return {}
    return {"drive": read_json(folder / DRIVE_FILE, "the account of the drive")}


def _own_claim(folder: Path) -> list[str]:
    """Return what the map states of itself: the check by points left out, and its classes."""
    from survey.scoring.standards.map_classes import own_claim

    return own_claim(Reconstruction.read(folder))


def _drive_lines(content: dict[str, Any]) -> list[str]:
    """Return how each drive ended, and what the loss of rovers cost."""
    lines = []
    drives = content.get("drives", [content["drive"]] if "drive" in content else [])
    for k, drive in enumerate(drives, 1):
        name = "drive" if len(drives) == 1 else f"rover {k}"
        reached = f"{drive['ending']} after {drive['progress_m']:.0f} of {drive['route_m']:.0f} m"
        lines.append(fact_line(name, reached))
    if "losses" in content:
        losses = content["losses"]
        n_lost = len(losses["lost"])
        cost = (
            f"{n_lost} rover{'s' * (n_lost > 1)}; swaths not driven {losses['swaths_not_driven_m']:.0f} m, extra way "
            f"{losses['extra_length_m']:.0f} m, extra time {losses['extra_time_s']:.0f} s"
        )
        lines.append(fact_line("losses", cost))
    return lines


class _JsonLines(logging.Formatter):
    def format(self, record: logging.LogRecord) -> str:
        when = datetime.fromtimestamp(record.created, UTC).isoformat(timespec="milliseconds")
        entry = {
            "time": when,
            "level": record.levelname.lower(),
            "logger": record.name,
            "message": record.getMessage(),
        }
        return log_line(entry)


@contextmanager
def logged_to(path: Path, verbose: int | None) -> Iterator[None]:
    """Append log records of firnline's packages to a file of JSON lines."""
    cut_incomplete_line(path)
    handlers: list[logging.Handler] = [logging.FileHandler(path, encoding="utf-8")]
    handlers[0].setFormatter(_JsonLines())
    if verbose is not None:
        handlers.append(logging.StreamHandler())
        handlers[-1].setLevel(logging.DEBUG if verbose else logging.WARNING)
    loggers = [logging.getLogger(name) for name in _PACKAGES]
    levels = [logger.level for logger in loggers]
    for logger in loggers:
        logger.setLevel(logging.DEBUG)
        for handler in handlers:
            logger.addHandler(handler)
    try:
        yield
    finally:
        for logger, level in zip(loggers, levels, strict=True):
            logger.setLevel(level)
            for handler in handlers:
                logger.removeHandler(handler)
        for handler in handlers:
            handler.close()
