"""A run builds its world once, from the opening of its folder to the end of the simulation."""

from sim.mission.runs import open_run
from sim.mission.stages import run_mission
from sim.world import site
from sim.world.site import SharedWorld
from tests.sim.small_missions import mission_with


def test_the_world_is_built_once(tmp_path, monkeypatch):
    built = []
    build = site.build_world
    monkeypatch.setattr("sim.world.site.build_world", lambda mission: built.append(1) or build(mission))
    mission = mission_with()
    world = SharedWorld(mission)
    run = open_run(mission, tmp_path, world=world)
    run_mission(mission, run, until="simulate", world=world, workers=1)
    assert run.has("simulate")
    assert len(built) == 1
