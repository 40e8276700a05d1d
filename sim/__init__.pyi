"""Public names and the modules that define them."""

from sim.config.mission import MissionConfig as MissionConfig
from sim.mission.runs import open_run as open_run
from sim.mission.runs import read_mission as read_mission
from sim.mission.stages import run_mission as run_mission
from sim.simulate.simulation import simulate_statistical as simulate_statistical
from sim.world.site import World as World
from sim.world.site import build_world as build_world
