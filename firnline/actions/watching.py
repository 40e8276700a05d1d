"""Follow a survey while it is driven."""

from collections.abc import Callable, Mapping
from typing import Any

from survey.core.quantity_text import duration_text


def text_of(entry: dict[str, Any]) -> str:
    """Return an event as a line, and nothing for inputs.

    Parameters
    ----------
    entry : dict
        Of the log.

    Returns
    -------
    str
        Without a line feed.

    Examples
    --------
    >>> text_of({"event": "warning", "time_s": 61.0, "about": "stuck", "text": "no movement for 90 s"})
    '1 min  WARNING no movement for 90 s'
    """
    kind = entry.get("event")
    if kind is None:
        return ""
    return f"{duration_text(entry['time_s'])}  {_WORDS[kind](entry)}"


def closing_line(counts: Mapping[str, int]) -> str:
    """Return the line at the end of a watch: what arrived, and why there is no map where there is none.

    Parameters
    ----------
    counts : mapping of str to int
        Numbers of inputs and events by kind.

    Returns
    -------
    str
        Without a line feed.

    Examples
    --------
    >>> closing_line({"sample": 300, "refused": 299})
    'end  300 samples, 299 of them refused, 0 swaths driven; no map, as fewer swaths were driven than the first fit needs'
    """
    text = (
        f"end  {counts.get('sample', 0)} samples, {counts.get('refused', 0)} of them refused, "
        f"{counts.get('swath', 0)} swaths driven"
    )
    if counts.get("map"):
        return text
    return f"{text}; no map, as fewer swaths were driven than the first fit needs"


def _map(entry: dict[str, Any]) -> str:
    return (
        f"{entry['driven_m']:.0f} m driven, {entry['samples']} samples, expected RMSE {entry['expected_rmse_m']:.3f} m, "
        f"largest σ {entry['largest_sigma_m']:.2f} m, {entry['class'] or 'no class yet'}"
    )


def _advice(entry: dict[str, Any]) -> str:
    asked = f"RMSE of {entry['limit_m']:.4g} m holds with {entry['probability']:.0%}"
    if entry["do"] == "stop":
        return f"STOP: the {asked}; {entry['class']}"
    if entry["do"] == "give up":
        return f"GIVE UP: the {asked}, and no further swaths would suffice"
    return (
        f"DRIVE ON: the {asked}, after the next swath with {entry['probability_with_next']:.0%} "
        f"(RMSE {entry['rmse_m']:.2f} m, then {entry['rmse_with_next_m']:.2f} m)"
    )


_WORDS: dict[str, Callable[[dict[str, Any]], str]] = {
    "map": _map,
    "advice": _advice,
    "swath": lambda entry: f"{entry['swaths']} swaths driven",
    "warning": lambda entry: f"WARNING {entry['text']}",
    "refused": lambda entry: f"a sample was refused: {entry['reason']}",
}
