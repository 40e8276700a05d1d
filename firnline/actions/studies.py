"""Many runs: Monte Carlo studies, rehearsals of a mission, and sensor errors that are fitted to runs."""

import csv
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from firnline.actions.interface import Preview, Progress, Result, fact_line, no_progress, previewed_by
from firnline.actions.requests import MonteCarloRequest, RehearseRequest
from sim.mission.rehearsal import FaultEvent, fault_tree, summarize_outcomes
from sim.mission.runs import read_mission
from sim.montecarlo.config import read_study
from survey.core import PictureKind
from survey.core.documents import read_record
from survey.core.run_folder import RunFolder


@dataclass(frozen=True)
class StudyResult(Result):
    """Monte Carlo study, whose files are in its folder.

    Parameters
    ----------
    folder : pathlib.Path
        Folder of the study.
    page : pathlib.Path
        Its report.
    """

    folder: Path
    page: Path

    def facts(self) -> dict[str, Any]:
        """Return the fewest swaths of every curve, from files that are checked."""
        read_record(self.folder)
        with (self.folder / "minimum_swaths.csv").open(encoding="utf-8", newline="") as file:
            rows = list(csv.DictReader(file))
        return {"study": str(self.folder), "report": str(self.page), "minimum_swaths": rows}

    def lines(self) -> list[str]:
        """Return the fewest swaths of every curve, and the places of table and report."""
        lines = []
        for row in self.facts()["minimum_swaths"]:
            fewest, safe = row["fewest_by_mean"] or "none", row["fewest_by_90_percent"] or "none"
            lines.append(
                f"{row['terrain']}, {row['planner']}, {row['map']}: fewest swaths by the mean error {fewest}, in 90 % of "
                f"trials {safe}"
            )
        return [*lines, fact_line("table", self.folder / "trials.csv"), fact_line("report", self.page)]


def preview_montecarlo(request: MonteCarloRequest) -> Preview:
    """Check a study, and return where its trials would be stored."""
    from sim.montecarlo.study import require_study

    request.chosen_engine()
    study = read_study(request.study, request.settings)
    require_study(study)
    return Preview.of([request.runs / study.name], {"trials": study.trials})


@previewed_by(preview_montecarlo)
def montecarlo(request: MonteCarloRequest, progress: Progress = no_progress) -> StudyResult:
    """Survey many random terrains by several planners, and count the swaths that a map class takes.

    Parameters
    ----------
    request : MonteCarloRequest
        Study file, settings and processes.
    progress : callable
        Called with what is done, how many are done, and how many there are.

    Returns
    -------
    StudyResult
        The study; trials are stored as they finish.

    Raises
    ------
    ConfigError
        A setting or an engine that is unknown or wrong.
    """
    from sim.montecarlo.study import run_study

    engine, study = request.chosen_engine(), read_study(request.study, request.settings)
    folder = request.runs / study.name
    page = run_study(
        study,
        folder,
        engine=engine,
        workers=request.workers,
        scheduler=request.scheduler,
        fresh=request.fresh,
        pictures=request.pictures,
        watch=lambda done, total: progress("trials", done, total),
    )
    return StudyResult(folder, page)


@dataclass(frozen=True)
class RehearsalResult(Result):
    """Rehearsal of a mission: how often it reached its class, and why it did not.

    Parameters
    ----------
    folder : pathlib.Path
        Folder of the outcomes.
    wanted : str
        The class.
    outcomes : list of dict
        Outcome of each run.
    pictures : {"png", "pdf", "svg"}
        Format of the picture.
    """

    folder: Path
    wanted: str
    outcomes: list[dict[str, Any]]
    pictures: PictureKind = "png"

    def write(self) -> "RehearsalResult":
        """Draw the fault tree beside the outcomes.

        Returns
        -------
        RehearsalResult
            The same.
        """
        from sim.mission.rehearsal import fault_tree_plot
        from survey.figures.style import write_pictures

        figure = fault_tree_plot(summarize_outcomes(self.outcomes), fault_tree(self.outcomes))
        write_pictures(self.folder, {self._picture.stem: figure}, self.pictures)
        return self

    @property
    def _picture(self) -> Path:
        return self.folder / f"fault_tree.{self.pictures}"

    def facts(self) -> dict[str, Any]:
        """Return probability, fault tree and outcomes."""
        tree = _nested(fault_tree(self.outcomes))
        found = summarize_outcomes(self.outcomes)._asdict()
        return {"folder": str(self.folder), **found, "fault_tree": tree, "runs": self.outcomes}

    def lines(self) -> list[str]:
        """Return the probability with its interval, and the events of the fault tree."""
        found = summarize_outcomes(self.outcomes)
        low, high = found.interval
        return [
            f"{self.wanted} met in {found.counts['met']} of {found.n_runs} runs: probability "
            f"{found.probability:.2f} (95 %: {low:.2f} to {high:.2f})",
            *_part_lines(fault_tree(self.outcomes), ""),
            fact_line("fault tree", self._picture),
            fact_line("outcomes", self.folder),
        ]


def preview_rehearsal(request: RehearseRequest) -> Preview:
    """Check a mission, and return where the outcomes of its rehearsal would be stored."""
    from sim.mission.rehearsal import rehearsal_folder

    request.chosen_engine()
    mission = read_mission(request.mission, request.settings)
    return Preview.of([rehearsal_folder(mission, request.runs)], {"runs": request.n_runs})


@previewed_by(preview_rehearsal)
def rehearse(request: RehearseRequest, progress: Progress = no_progress) -> RehearsalResult:
    """Run a mission many times with other seeds and drawn settings, and count how often it reaches its class.

    Parameters
    ----------
    request : RehearseRequest
        Mission, settings and processes.
    progress : callable
        Called with what is done, how many are done, and how many there are.

    Returns
    -------
    RehearsalResult
        The outcomes; they are stored as they finish.

    Raises
    ------
    ConfigError
        A setting or an engine that is unknown or wrong.
    """
    from sim.mission.rehearsal import outcomes
    from sim.mission.rehearsal import rehearse_mission as run_all_of

    engine, mission = request.chosen_engine(), read_mission(request.mission, request.settings)
    folder = run_all_of(
        mission,
        request.runs,
        request.n_runs,
        engine=engine,
        workers=request.workers,
        scheduler=request.scheduler,
        watch=lambda done, total: progress("runs", done, total),
    )
    found = outcomes(folder, request.n_runs)
    return RehearsalResult(folder, mission.score.require, found, request.pictures)


def _part_lines(event: FaultEvent, indent: str) -> list[str]:
    """Return the events below one, each with its number of runs."""
    lines = []
    for part in event.parts:
        lines += [fact_line(f"{indent}{part.name}", part.n_runs), *_part_lines(part, f"{indent}  ")]
    return lines


def _nested(event: FaultEvent) -> dict[str, Any]:
    """Return an event and those below it as JSON has them."""
    return {"name": event.name, "n_runs": event.n_runs, "parts": [_nested(part) for part in event.parts]}


def fit(runs: Sequence[Path]) -> str:
    """Fit the sensor errors of the statistical fidelity to the errors of drives with images.

    Parameters
    ----------
    runs : sequence of pathlib.Path
        Run folders of missions in the vision fidelity.

    Returns
    -------
    str
        Section of a mission file.
    """
    import tomlkit

    from sim.config.mission import SensorConfig
    from sim.simulate.error_model import errors_of, fit_sensor_errors

    found = fit_sensor_errors([errors_of(RunFolder.find(run)) for run in runs]).model_dump(mode="json")
    usual = SensorConfig().model_dump(mode="json")
    return tomlkit.dumps({"sensors": {name: value for name, value in found.items() if value != usual[name]}})
