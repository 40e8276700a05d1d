"""Rehearsal of a mission: many runs of it with other seeds and drawn settings, and how often it reaches its class.

Every run has a seed of its own, from which terrain (where it is random), receivers, weather, landmarks, losses and
faults with a probability follow. Outcomes are stored as they finish, so that a rehearsal that was stopped continues;
they do not depend on the number of processes.
"""

import tempfile
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

from scipy.stats import beta

from sim.config.mission import MissionConfig
from sim.mission.fleet import endings, n_lost, with_drawn_losses
from sim.mission.runs import open_run, planned_place, resolved_text
from sim.mission.stages import run_mission
from sim.mission.versions import current_versions, refuse_other_versions
from sim.simulate.simulated_drive import Ending
from survey.core.config import validated, with_overrides
from survey.core.documents import read_json, write_json
from survey.core.errors import FirnlineError
from survey.core.executors import Engine, run_all
from survey.core.runs.store import RunFolder
from survey.core.streams import stream
from survey.data.route import Route

CAUSES = {
    "met": "class met",
    "refused": "mission refused",
    "lost": "rover lost",
    "level": "level of the map",
    "shape": "shape of the map",
}
"""Outcomes of a run: the class met, or why it was not."""
DRAWN_LOSS = "drawn loss"
"""Event of a run in which a rover is lost by the probability of losses."""
_FACTS = "rehearsal.json"
_CONFIDENCE = 0.95


class RehearsalSummary(NamedTuple):
    """Result of a rehearsal.

    Parameters
    ----------
    n_runs : int
        Number of runs.
    counts : dict of str to int
        Number of runs with each outcome of `CAUSES`.
    probability : float
        Share of runs that met the class.
    interval : tuple of float
        Its 95 % interval (Clopper and Pearson 1934).
    """

    n_runs: int
    counts: dict[str, int]
    probability: float
    interval: tuple[float, float]


def rehearsal_folder(mission: MissionConfig, runs: Path) -> Path:
    """Return the folder that a rehearsal has, whether it has begun or not; nothing is written.

    Parameters
    ----------
    mission : MissionConfig
        The mission.
    runs : pathlib.Path
        Folder of all runs.

    Returns
    -------
    pathlib.Path
        Beside the folder of the mission's run.
    """
    place = planned_place(mission, runs)
    return place.with_name(f"rehearsal-{place.name}")


def rehearse(
    mission: MissionConfig,
    runs: Path,
    n_runs: int,
    *,
    engine: Engine = "processes",
    workers: int | None = None,
    scheduler: str | None = None,
    watch: Callable[[int, int], None] | None = None,
) -> Path:
    """Run a mission many times, and store what becomes of each run.

    Parameters
    ----------
    mission : MissionConfig
        The mission; its ``rehearsal`` names the settings that are drawn.
    runs : pathlib.Path
        Folder of all runs.
    n_runs : int
        Number of runs; those that are stored are not done again.
    engine, workers, scheduler
        See `survey.core.executors.run_all`; outcomes are the same whatever they are. Workers of a scheduler on other
        machines need the files that the mission names at the same places.
    watch : callable, optional
        Called with the numbers of runs that are done and wanted, after each run.

    Returns
    -------
    pathlib.Path
        Folder with one file for each run.

    Raises
    ------
    InputError
        The mission itself is refused, or other versions of the packages have begun the rehearsal.
    """
    folder = rehearsal_folder(mission, runs)
    folder.mkdir(parents=True, exist_ok=True)
    if (folder / _FACTS).exists():
        refuse_other_versions(
            read_json(folder / _FACTS, "the rehearsal")["versions"], f"the rehearsal {folder}", "remove it"
        )
    write_json(folder / _FACTS, {"versions": current_versions(), "mission": resolved_text(mission)})
    left = [k for k in range(n_runs) if not _file(folder, k).exists()]
    chosen: Engine = "serial" if engine == "processes" and workers == 1 else engine
    done = run_all(partial(_rehearsed, mission), left, engine=chosen, workers=workers, scheduler=scheduler)
    for n, (k, facts) in enumerate(done, n_runs - len(left) + 1):
        write_json(_file(folder, k), facts)
        if watch is not None:
            watch(n, n_runs)
    return folder


def drawn_mission(mission: MissionConfig, run: int) -> tuple[MissionConfig, dict[str, float]]:
    """Return the mission of one run, and the values of its drawn settings."""
    seed = int(stream(mission.seed, "rehearsal", run).integers(2**31))
    drawn = {
        one.setting: float(stream(seed, "rehearsal", one.setting).uniform(*one.between))
        for one in mission.rehearsal
    }
    values = mission.model_dump(mode="json", exclude_none=True) | {"seed": seed, "rehearsal": []}
    settings = [f"{name}={value!r}" for name, value in drawn.items()]
    changed = validated(MissionConfig, with_overrides(values, settings), f"run {run} of the rehearsal")
    return changed.read_from(mission.path("")), drawn


def outcomes(folder: Path, n_runs: int) -> list[dict[str, Any]]:
    """Return the stored outcomes of the first runs, in their order."""
    return [read_json(_file(folder, k), "the outcome of a run") for k in range(n_runs)]


def summarized(found: Sequence[dict[str, Any]]) -> RehearsalSummary:
    """Return the probability of the class, and the number of runs for each outcome.

    Examples
    --------
    >>> summary = summarized([{"cause": "met"}] * 9 + [{"cause": "lost"}])
    >>> summary.probability, summary.counts["lost"]
    (0.9, 1)
    """
    counts = {cause: sum(one["cause"] == cause for one in found) for cause in CAUSES}
    n, met, rest = len(found), counts["met"], 0.5 * (1.0 - _CONFIDENCE)
    low = float(beta.ppf(rest, met, n - met + 1)) if met else 0.0
    high = float(beta.ppf(1.0 - rest, met + 1, n - met)) if met < n else 1.0
    return RehearsalSummary(n, counts, met / n, (low, high))


def _file(folder: Path, run: int) -> Path:
    return folder / f"run-{run + 1:04d}.json"


def _rehearsed(mission: MissionConfig, number: int) -> dict[str, Any]:
    """Run one mission in a folder that is removed, and return its outcome."""
    changed, drawn = drawn_mission(mission, number)
    facts: dict[str, Any] = {"run": number + 1, "seed": changed.seed, "drawn": drawn}
    with tempfile.TemporaryDirectory() as place:
        try:
            run = open_run(changed, Path(place))
            run_mission(changed, run, until="score", workers=1)
            return facts | _outcome(changed, run)
        except FirnlineError as error:
            return facts | {"cause": "refused", "message": str(error), "events": []}


def _outcome(mission: MissionConfig, run: RunFolder) -> dict[str, Any]:
    """Return whether the class was met, and why not: a lost rover first, else the larger part of the error."""
    score = read_json(run.folder("score") / "score.json", "the score")
    errors, lost = score["elevation"], n_lost(run.folder("simulate"))
    wanted = mission.score.require
    is_met = any(v["met"] for v in score["verdicts"] if v["map_class"].lower().replace(" ", "-") == wanted)
    is_level = abs(errors["bias_m"]) > errors["std_m"]
    cause = "met" if is_met else "lost" if lost else "level" if is_level else "shape"
    return {
        "cause": cause,
        "events": _events(mission, run),
        "rmse_m": errors["rmse_m"],
        "bias_m": errors["bias_m"],
        "coverage_95": score["calibration"]["coverage_95"],
        "n_lost": lost,
    }


def _events(mission: MissionConfig, run: RunFolder) -> list[str]:
    """Return the events of a run, each once: faults, drawn losses, and how drives ended early."""
    route = Route.read(run.folder("plan") / "route.geojson")
    faults = {
        f"{fault.component}: {fault.failure}"
        for rover in range(route.n_rovers)
        for fault in mission.of_rover(rover).faults
    }
    early = set(endings(run.folder("simulate"))) - {Ending.ARRIVED.value}
    n_drawn = len(with_drawn_losses(route, mission).faults) - len(mission.faults)
    drawn = {DRAWN_LOSS} if n_drawn else set()
    return sorted(faults | drawn | early)
