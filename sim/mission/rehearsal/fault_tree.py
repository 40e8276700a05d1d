"""Fault tree of a rehearsal: runs that missed the class, by the kind of failure and by their faults."""

from collections import Counter
from collections.abc import Sequence
from typing import Any, NamedTuple

from sim.mission.rehearsal.runs import CAUSES

NOTHING = "sensors and terrain alone"
"""Name of runs without a fault."""
_MAP = ("level", "shape")


class FaultEvent(NamedTuple):
    """Event of a fault tree with the events that it consists of; each run counts in one of these.

    Parameters
    ----------
    name : str
        What happened.
    n_runs : int
        Number of runs in which it did.
    parts : tuple of FaultEvent
        Events that it consists of, the most frequent first.
    """

    name: str
    n_runs: int
    parts: tuple["FaultEvent", ...] = ()


def fault_tree(found: Sequence[dict[str, Any]]) -> FaultEvent:
    """Return the tree of the runs that missed the class.

    Parameters
    ----------
    found : sequence of dict
        Outcomes, as `sim.mission.rehearsal.runs.outcomes` returns them.

    Returns
    -------
    FaultEvent
        The top event. Below it stand refused missions, lost rovers, and errors of the map in level or shape; below
        these the faults and losses of the runs, together where a run had several.

    Examples
    --------
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
