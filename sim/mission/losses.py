"""Losses of rovers: the faults that stop one for good, and accounts of how drives ended.

A rover is lost where its tracks stop, by a fault of the mission or by one that is drawn. A drive without images ends
there; `write_account` writes how it ended, as a drive in images does. `account_of_losses` compares the driven with the
planned routes of a fleet.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import survey
from planners.routes.replanning import Loss, cut_short
from planners.routes.rover import effort, predicted
from sim.config.mission import MissionConfig
from sim.config.sensors import FaultConfig, faults_of
from sim.simulate.simulated_drive import DRIVE_FILE, Ending
from sim.world.site import World
from survey.core import stream, write_json

_EARLIEST, _LATEST = 0.1, 0.9


def with_drawn_losses(route: survey.Route, mission: MissionConfig) -> MissionConfig:
    """Return the mission with a fault for each rover that is drawn to be lost."""
    drawn: list[FaultConfig] = []
    for rover in range(route.n_rovers):
        rng = stream(mission.seed, "fleet", "loss", rover)
        if rng.random() < mission.fleet.loss_probability:
            length_m = float(sum(leg.length_m for leg in route.legs if leg.rover == rover))
            at_s = rng.uniform(_EARLIEST, _LATEST) * length_m / mission.rover.speed_m_s
            drawn.append(FaultConfig(component="tracks", failure="stopped", from_s=at_s, rover=rover + 1))
    return mission.model_copy(update={"faults": (*mission.faults, *drawn)})


def loss_on(route: survey.Route, mission: MissionConfig) -> Loss | None:
    """Return when and where a rover that follows its route exactly is stopped for good by a fault, if it is."""
    stops = [fault.from_s for fault in faults_of(mission.faults, "tracks") if fault.failure == "stopped"]
    length_m, speed_m_s = float(sum(leg.length_m for leg in route.legs)), mission.rover.speed_m_s
    first_s = min(stops, default=float("inf"))
    if first_s * speed_m_s >= length_m:
        return None
    if first_s < 2.0:
        raise survey.InputError(
            f"a rover stops after {first_s:g} s, before it has recorded anything; let the fault begin later."
        )
    return Loss(0, first_s, first_s * speed_m_s)


def write_account(world: World, planned: survey.Route, mission: MissionConfig, folder: Path) -> None:
    """Write how a drive without images ended; a drive with images has written it."""
    loss = loss_on(planned, mission)
    driven = planned if loss is None else cut_short(planned, loss)
    taken = effort(driven.path(), mission.rover, world.terrain)
    length_m = float(sum(leg.length_m for leg in planned.legs))
    account = {
        "ending": (Ending.ARRIVED if loss is None else Ending.STALLED).value,
        "progress_m": round(length_m if loss is None else loss.progress_m, 2),
        "route_m": round(length_m, 2),
        "duration_s": float(driven.length_m / mission.rover.speed_m_s),
        "energy_j": round(taken.energy_j, 1),
    }
    write_json(folder / DRIVE_FILE, account)


def account_of_losses(
    planned: survey.Route,
    driven: survey.Route,
    losses: Sequence[Loss],
    left_m: Sequence[float],
    mission: MissionConfig,
) -> dict[str, Any]:
    """Return who was lost, the swaths left out by the end, and what driving them again cost."""
    before, after = (predicted(route.legs, mission.rover, crs=route.crs) for route in (planned, driven))
    planned_m, driven_m = (sum(leg.length_m for leg in route.swaths) for route in (planned, driven))
    return {
        "lost": [
            {
                "rover": loss.rover + 1,
                "time_s": round(loss.time_s, 1),
                "progress_m": loss.progress_m,
                "swaths_left_m": swaths_m,
            }
            for loss, swaths_m in zip(losses, left_m, strict=True)
        ],
        "on_loss": mission.fleet.on_loss,
        "swaths_not_driven_m": max(planned_m - driven_m, 0.0),
        "extra_length_m": after["length_m"] - before["length_m"],
        "extra_time_s": after["time_s"] - before["time_s"],
    }
