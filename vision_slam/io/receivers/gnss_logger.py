"""Text logs of Android's GnssLogger: lines of fixes by GPS, fused and network positions."""

from pathlib import Path

import numpy as np

from survey.core.crs.vertical_datum import ELLIPSOIDAL
from survey.core.errors import InputError
from vision_slam.io.receivers.rows import ReceiverFixes, axis_sigma_m

# Names of the fields by version of the app; the order of the last resort is that of version 2.
_FIELDS = {
    "latitude": ("latitudedegrees", "latitude"),
    "longitude": ("longitudedegrees", "longitude"),
    "height": ("altitudemeters", "altitude"),
    "accuracy": ("accuracymeters", "accuracy"),
    "time": ("unixtimemillis", "(utc)timeinms", "timeinms"),
}
_USUAL = "Fix,Provider,Latitude,Longitude,Altitude,Speed,Accuracy,(UTC)TimeInMs"
# The satellites' own positions first, then those that the phone has fused, then those by radio cells.
_PROVIDERS = ("GPS", "FLP", "FUSED", "NLP", "NETWORK", "GT")


def read_gnss_logger(file: Path) -> ReceiverFixes:
    """Read the fixes of a log: those of one provider, GPS where it has at least two.

    Android's accuracy is the radius of 68 %; it becomes a standard deviation in each axis. Fixes without an
    altitude, which phones log before satellites are found, are left out and counted.

    Parameters
    ----------
    file : Path
        Text log.

    Returns
    -------
    ReceiverFixes
        In the order of their times; of those with the same time the first.

    Raises
    ------
    InputError
        A line is damaged, or no provider has two fixes.
    """
    lines = file.read_text(encoding="utf-8", errors="replace").splitlines()
    header = next((line.lstrip("# ") for line in lines if line.lstrip("# ").startswith("Fix,Prov")), _USUAL)
    columns = _columns(header)
    by_provider: dict[str, list[tuple[float, ...]]] = {}
    n_without_height = 0
    for number, line in enumerate(lines, start=1):
        if line.startswith("Fix,"):
            words = line.split(",")
            fix = _fix(words, columns, f"{file}, line {number}")
            if np.isnan(fix[3]):
                n_without_height += 1
            else:
                by_provider.setdefault(words[1].upper(), []).append(fix)
    chosen = next((p for p in _PROVIDERS if len(by_provider.get(p, [])) >= 2), None)
    if chosen is None:
        raise InputError(
            f"{file} holds {sum(map(len, by_provider.values()))} fixes and no two of one provider; "
            "log for longer, with location switched on."
        )
    table = np.array(by_provider[chosen])
    _, first = np.unique(table[:, 0], return_index=True)
    table = table[first]
    others = ", ".join(f"{len(rows)} of {name}" for name, rows in by_provider.items() if name != chosen)
    note = f"fixes of the provider {chosen}" + (f" ({others} are left out)" if others else "")
    has_sigma = bool((table[:, 4] > 0.0).all())
    return ReceiverFixes(
        1e-3 * table[:, 0],
        table[:, 1:4],
        axis_sigma_m(table[:, 4]) if has_sigma else None,
        n_without_fix=n_without_height,
        vertical_datum=ELLIPSOIDAL,
        notes=(note,),
    )


def _columns(header: str) -> dict[str, int]:
    names = [name.strip().lower() for name in header.split(",")]
    return {
        kind: next((names.index(name) for name in spellings if name in names), -1)
        for kind, spellings in _FIELDS.items()
    }


def _fix(words: list[str], columns: dict[str, int], where: str) -> tuple[float, ...]:
    """Return time [ms], longitude, latitude [deg], height (NaN without) and accuracy (0 without) [m] of one line."""
    try:
        values = {kind: words[at].strip() for kind, at in columns.items() if at >= 0}
        height = values["height"] or "nan"
        fix = (*(float(values[kind]) for kind in ("time", "longitude", "latitude")), float(height))
        accuracy = float(values.get("accuracy") or 0.0)
    except (ValueError, IndexError, KeyError) as error:
        raise InputError(
            f"{where} is no fix with time, longitude, latitude and altitude ({error}); correct or remove it."
        ) from error
    if not (abs(fix[1]) <= 180.0 and abs(fix[2]) <= 90.0 and np.isfinite(fix[:3]).all()):
        raise InputError(f"{where}: {fix[2]:g}, {fix[1]:g} are no degrees; correct or remove the line.")
    return (*fix, accuracy)
