"""Rehearsal of a mission: many runs with other seeds and drawn settings, and how often it reaches its class.

Every run has a seed of its own, from which terrain (where it is random), receivers, weather, landmarks, losses and
faults with a probability follow. Outcomes are stored as they finish, so that a rehearsal that was stopped continues;
they do not depend on the number of processes. The fault tree sorts the runs that missed the class by the kind of failure
and by their faults; the figure draws it.
"""

import tempfile
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from pathlib import Path
from textwrap import fill
from typing import Any, NamedTuple

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from scipy.special import betaincinv

from sim.config.mission import MissionConfig
from sim.mission.fleet import endings, n_lost
from sim.mission.losses import with_drawn_losses
from sim.mission.runs import current_versions, open_run, planned_place, refuse_other_versions, resolved_text
from sim.mission.stages import run_mission
from sim.simulate.simulated_drive import Ending
from survey import FirnlineError, Route
from survey.core import read_json, stream, validated, with_overrides, write_json
from survey.core.executors import Engine, run_all
from survey.core.run_folder import RunFolder
from survey.figures.style import FULL_IN, MUTED, NO_GO, VEIL, styled

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

    `n_runs`: number of runs. `counts`: number of runs with each outcome of `CAUSES`. `probability`: share of
    runs that met the class. `interval`: its 95 % interval (Clopper and Pearson 1934).
    """

    n_runs: int
    counts: dict[str, int]
    probability: float
    interval: tuple[float, float]


def rehearsal_folder(mission: MissionConfig, runs: Path) -> Path:
    """Return the folder that a rehearsal has, whether it has begun or not; nothing is written."""
    place = planned_place(mission, runs)
    return place.with_name(f"rehearsal-{place.name}")


def rehearse_mission(
    mission: MissionConfig,
    runs: Path,
    n_runs: int,
    *,
    engine: Engine = "processes",
    workers: int | None = None,
    scheduler: str | None = None,
    watch: Callable[[int, int], None] | None = None,
) -> Path:
    """Run a mission many times, and store what becomes of each run."""
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


def draw_mission(mission: MissionConfig, run: int) -> tuple[MissionConfig, dict[str, float]]:
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


def summarize_outcomes(found: Sequence[dict[str, Any]]) -> RehearsalSummary:
    """Return the probability of the class, and the number of runs for each outcome.

    >>> summary = summarize_outcomes([{"cause": "met"}] * 9 + [{"cause": "lost"}])
    >>> summary.probability, summary.counts["lost"]
    (0.9, 1)
    """
    counts = {cause: sum(one["cause"] == cause for one in found) for cause in CAUSES}
    n, met, rest = len(found), counts["met"], 0.5 * (1.0 - _CONFIDENCE)
    low = float(betaincinv(met, n - met + 1, rest)) if met else 0.0
    high = float(betaincinv(met + 1, n - met, 1.0 - rest)) if met < n else 1.0
    return RehearsalSummary(n, counts, met / n, (low, high))


def _file(folder: Path, run: int) -> Path:
    return folder / f"run-{run + 1:04d}.json"


def _rehearsed(mission: MissionConfig, number: int) -> dict[str, Any]:
    """Run one mission in a folder that is removed, and return its outcome."""
    changed, drawn = draw_mission(mission, number)
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


NOTHING = "sensors and terrain alone"
"""Name of runs without a fault."""
_MAP = ("level", "shape")


class FaultEvent(NamedTuple):
    """Event of a fault tree with the events that it consists of; each run counts in one of these.

    `name`: what happened. `n_runs`: number of runs in which it did. `parts`: events that it consists of, the
    most frequent first.
    """

    name: str
    n_runs: int
    parts: tuple["FaultEvent", ...] = ()


def fault_tree(found: Sequence[dict[str, Any]]) -> FaultEvent:
    """Return the tree of the runs that missed the class.

    >>> lost = {"cause": "lost", "events": ["stalled", "tracks: stopped"]}
    >>> tree = fault_tree([{"cause": "met", "events": []}, lost, {"cause": "level", "events": []}])
    >>> tree.n_runs, [part.name for part in tree.parts]
    (2, ['error of the map', 'rover lost'])
    >>> tree.parts[1].parts[0].name
    'stalled, tracks: stopped'
    """
    missed = [one for one in found if one["cause"] != "met"]
    of_map = _sorted([_by_events(CAUSES[cause], missed, cause) for cause in _MAP])
    n_map = sum(part.n_runs for part in of_map)
    causes = [_by_events(CAUSES[cause], missed, cause) for cause in CAUSES if cause not in ("met", *_MAP)]
    return FaultEvent(
        "class missed", len(missed), _sorted([*causes, FaultEvent("error of the map", n_map, of_map)])
    )


def _by_events(name: str, missed: Sequence[dict[str, Any]], cause: str) -> FaultEvent:
    """Return the event of one cause, by the faults of its runs."""
    faults = Counter(_faults(one) for one in missed if one["cause"] == cause)
    parts = [FaultEvent(events, n) for events, n in faults.items()]
    return FaultEvent(name, sum(faults.values()), _sorted(parts))


def _faults(one: dict[str, Any]) -> str:
    """Return the faults of a run; for a refused one, the reason."""
    return str(one.get("message") or ", ".join(one["events"]) or NOTHING)


def _sorted(events: Sequence[FaultEvent]) -> tuple[FaultEvent, ...]:
    """Return the events that happened, the most frequent first."""
    return tuple(sorted((e for e in events if e.n_runs), key=lambda event: (-event.n_runs, event.name)))


_ROW_IN, _WIDEST = 0.42, 34
_COLUMNS = (0.0, 0.26, 0.52, 0.78)
_WIDTH = 0.21


class _Box(NamedTuple):
    event: FaultEvent
    column: int
    row: float
    parent_row: float | None


@styled
def fault_tree_plot(summary: RehearsalSummary, tree: FaultEvent) -> Figure:
    """Draw the fault tree: from the missed class to the right, how the runs failed, and their faults."""
    boxes = list(_placed_boxes(tree, 0, 0.0, None))
    n_rows = max(_n_leaves(tree), 1)
    figure = Figure(figsize=(FULL_IN, 0.7 + _ROW_IN * n_rows), layout="constrained")
    axes = figure.add_subplot()
    axes.set_axis_off()
    axes.set(xlim=(-0.01, 1.0), ylim=(n_rows - 0.5, -0.5))
    low, high = summary.interval
    axes.set_title(
        f"Class met in {summary.probability:.0%} of {summary.n_runs} runs ({low:.0%} to {high:.0%})"
    )
    for box in boxes:
        _draw_box(axes, box, summary.n_runs)
    return figure


def _n_leaves(event: FaultEvent) -> int:
    return sum(map(_n_leaves, event.parts)) if event.parts else 1


def _placed_boxes(
    event: FaultEvent, column: int, first_row: float, parent_row: float | None
) -> Iterator[_Box]:
    """Yield an event and its parts, each in the middle of the rows of its leaves."""
    row = first_row + 0.5 * (_n_leaves(event) - 1)
    yield _Box(event, column, row, parent_row)
    for part in event.parts:
        yield from _placed_boxes(part, column + 1, first_row, row)
        first_row += _n_leaves(part)


def _draw_box(axes: Axes, box: _Box, n_runs: int) -> None:
    """Draw the box of an event, and its line to the event before."""
    left = _COLUMNS[box.column]
    if box.parent_row is not None:
        gate = left - 0.5 * (_COLUMNS[1] - _WIDTH)
        before = _COLUMNS[box.column - 1] + _WIDTH
        axes.plot(
            [before, gate, gate, left], [box.parent_row] * 2 + [box.row] * 2, color=MUTED, linewidth=0.8
        )
    share = box.event.n_runs / n_runs
    axes.barh(box.row, _WIDTH, 0.8, left, color=VEIL)
    axes.barh(box.row, _WIDTH * share, 0.8, left, color=NO_GO, alpha=0.45)
    label = fill(f"{box.event.name}: {box.event.n_runs}", _WIDEST, max_lines=2)
    axes.text(left + 0.006, box.row, label, va="center", fontsize=8)
