"""Missions of two rovers, one of which stops at two fifths of its way: what is driven again, and how good the map is."""

import tempfile
from pathlib import Path
from typing import Any

from benchmarks.fleet.joint_maps import judged, stated_errors
from benchmarks.fleet.sites import FAMILIES, mission_on
from sim.config.mission import MissionConfig
from sim.config.rover import FleetConfig
from sim.config.sensors import FaultConfig
from sim.mission.fleet import LOSS_FILE, route_of
from sim.mission.runs import open_run
from sim.mission.stages import run_mission
from sim.world.site import build_world
from survey import Reconstruction, Route
from survey.core.documents import read_json
from survey.scoring import certificate

_SHARE = 0.4


def outcome(seed: int) -> dict[str, Any]:
    """Run a mission without the loss up to its plan, then with the loss, replanned and not."""
    mission = mission_on(seed, FAMILIES[seed % len(FAMILIES)], n_rovers=2)
    with tempfile.TemporaryDirectory() as folder:
        run = open_run(mission, Path(folder))
        run_mission(mission, run, until="plan", workers=1)
        planned = Route.read(run.folder("plan") / "route.geojson")
        at_s = _SHARE * route_of(planned, 1).length_m / mission.rover.speed_m_s
        fault = FaultConfig(component="tracks", failure="stopped", from_s=at_s, rover=2)
        found = {
            on_loss: _mapped(mission, fault, on_loss, Path(folder)) for on_loss in ("replan", "continue")
        }
    return {"seed": seed, **found}


def _mapped(mission: MissionConfig, fault: FaultConfig, on_loss: str, runs: Path) -> dict[str, Any]:
    fleet = FleetConfig.model_validate({**mission.fleet.model_dump(), "on_loss": on_loss})
    lost = mission.model_copy(update={"faults": (fault,), "fleet": fleet})
    run = open_run(lost, runs)
    run_mission(lost, run, until="reconstruct", workers=1)
    mapped, world = Reconstruction.read(run.folder("reconstruct")), build_world(lost)
    scores = judged(world, mapped.mean.elevation, mapped.std.elevation, mapped.mean.grid())
    stated = certificate(mapped)
    limits = [] if stated is None else [verdict.limit_m for verdict in stated.absolute if verdict.met]
    classes = {"n_stated": len(limits), "n_missed": sum(scores.rmse_m > limit for limit in limits)}
    losses = read_json(run.folder("simulate") / LOSS_FILE, "the losses")
    return {
        **scores._asdict(),
        **classes,
        **stated_errors(mapped),
        **{key: losses[key] for key in ("swaths_not_driven_m", "extra_time_s")},
    }
