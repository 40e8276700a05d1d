"""Uploads to the simulated rover: time, losses, and kills of either side."""

import os
import time
from collections.abc import Iterator
from contextlib import suppress

import numpy as np

from benchmarks.live.rover_process import RoverKind, RoverProcess, rover
from benchmarks.report import Row
from live.link import LinkAddress, Vehicle
from live.mission.items import MISSION, AutopilotMission, LinkItem
from live.mission.transfer import fetch_items
from live.mission.vehicle_mission import upload
from survey.core.errors import InputError
from survey.core.streams import stream
from survey.interchange.missions import MissionItem

SEED = 20_291
_LIMIT_S, _N_ITEMS, _LOSS = 5.0, 2000, 0.3
_KILLED_ITEMS = 300


def mission_of(n_items: int) -> AutopilotMission:
    """Return a mission of waypoints ten metres apart."""
    return AutopilotMission(
        tuple(MissionItem(16, 3, (0, 0, 0, None, 61.0 + 1e-4 * k, -139.0, 0.5)) for k in range(n_items))
    )


def transfer_rows(quick: bool) -> Iterator[Row]:
    """Yield the time of an upload whose items come back equal."""
    mission = mission_of(_N_ITEMS)
    with rover() as one:
        upload(mission_of(3), one.address, patience_s=60.0)
        taken_s = min(_upload_s(mission, one.address) for _ in range(1 if quick else 3))
    yield Row.of(f"{_N_ITEMS} items uploaded, read back and equal: wall time", taken_s, "s", "<=", _LIMIT_S)


def loss_rows(quick: bool) -> Iterator[Row]:
    """Yield how uploads end over a link that loses 30 % of its packets."""
    for n_items in (20,) if quick else (50, _N_ITEMS):
        with rover(RoverKind(_LOSS, SEED)) as one:
            with Vehicle.connected(one.address, 120.0):
                began = time.perf_counter()
            ending = _ending(mission_of(n_items), one.address)
        name = f"{n_items} items at {_LOSS:.0%} loss"
        yield Row.of(f"{name}: equal, or ended with one sentence", float(ending is not None), "1", ">=", 1.0)
        yield Row(f"{name}: equal", float(ending == ""), "1")
        yield Row(f"{name}: time", time.perf_counter() - began, "s")


def _upload_s(mission: AutopilotMission, address: LinkAddress) -> float:
    """Return the wall time of an upload [s]."""
    began = time.perf_counter()
    upload(mission, address, patience_s=30.0)
    return time.perf_counter() - began


def _ending(mission: AutopilotMission, address: LinkAddress) -> str | None:
    """Upload; return nothing where it was equal, the sentence of the refusal, or None for anything else."""
    try:
        upload(mission, address, patience_s=20.0)
    except InputError as error:
        return str(error)
    return ""


def kill_rows(quick: bool) -> Iterator[Row]:
    """Yield how often the next call went on, and how often half a mission was held, after kills of either side."""
    n_kills = 2 if quick else 20
    rng = stream(SEED, "kills")
    halves = went_on = ended = 0
    with rover() as one:
        upload(mission_of(5), one.address, patience_s=60.0)
        for k in range(n_kills):
            _kill_an_upload(one.address, _KILLED_ITEMS + k, float(rng.uniform(0.0, 1.0)))
            held = _held(one.address)
            halves += held not in {5, *range(_KILLED_ITEMS, _KILLED_ITEMS + k + 1)}
            went_on += upload(mission_of(5), one.address, patience_s=30.0).items == 5
    for _ in range(n_kills):
        ended += _kill_a_rover(float(rng.uniform(0.0, 0.6)))
        with rover() as fresh:
            went_on += upload(mission_of(5), fresh.address, patience_s=60.0).items == 5
    yield Row.of(f"{n_kills} kills of the upload: times that half a mission was held", halves, "1", "<=", 0)
    yield Row.of(
        f"{n_kills} kills of the rover: uploads that ended with one sentence, or before",
        ended,
        "1",
        ">=",
        n_kills,
    )
    yield Row.of(f"{2 * n_kills} kills: next calls that went on", went_on, "1", ">=", 2 * n_kills)


def _kill_an_upload(address: LinkAddress, n_items: int, after: float) -> None:
    """Kill an uploading process after a share of its items was sent."""
    child = os.fork()
    if child == 0:

        def end_there(what: str, done: int, total: int) -> None:
            if what.startswith("sending") and done >= after * total:
                os._exit(9)

        with suppress(BaseException):
            upload(mission_of(n_items), address, patience_s=30.0, progress=end_there)
        os._exit(0)
    os.waitpid(child, 0)


def _held(address: LinkAddress) -> int:
    """Return how many items the rover holds, all of which have to be those of one mission; -1 where they are not.

    An upload that was complete when it was killed may take its place while the items are read. They are read twice then.
    """
    with Vehicle.connected(address, 60.0) as vehicle:
        return next((n for n in (_n_items(vehicle) for _ in range(2)) if n >= 0), -1)


def _n_items(vehicle: Vehicle) -> int:
    """Return how many items a reading of the mission gives; -1 where they are not those of one mission."""
    items = fetch_items(vehicle, MISSION)
    expected = [LinkItem.of(item) for item in mission_of(len(items)).items]
    return len(items) if all(a.agrees_with(b) for a, b in zip(expected, items, strict=True)) else -1


def _kill_a_rover(after: float) -> bool:
    """Kill a rover during an upload; return whether the upload ended with one sentence, or was complete before."""
    one = RoverProcess(RoverKind())
    upload(mission_of(3), one.address, patience_s=60.0)

    def kill_there(_: str, done: int, total: int) -> None:
        if done >= after * total and one.process.is_alive():
            one.kill()

    try:
        upload(mission_of(_KILLED_ITEMS), one.address, patience_s=1.0, progress=kill_there)
    except InputError as error:
        return str(error).count(". ") == 0
    finally:
        one.kill()
    return bool(np.isclose(after, 1.0))
