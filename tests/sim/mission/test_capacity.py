import re

import pytest

from sim.config.mission import MissionConfig
from sim.mission.capacity import require_survey, require_terrain
from survey.core.config import validated, with_overrides
from survey.core.errors import ConfigError, InputError

MISSION = {
    "schema_version": 1,
    "name": "small",
    "fidelity": "statistical",
    "terrain": {"source": "random", "size_m": 600.0},
    "planner": {"pattern": "lawnmower", "swaths": 4},
}


def check(*settings: str) -> None:
    mission = validated(MissionConfig, with_overrides(MISSION, settings), "the test")
    require_terrain(mission)
    require_survey(mission, (0.0, 0.0, 600.0, 600.0))


def test_ordinary_missions_pass():
    for fidelity in ("ideal", "statistical", "vision"):
        check(f"fidelity={fidelity}")
    check("planner.pattern=best", "planner.swaths=4")


LARGE = {
    "terrain.step_m": ("0.001", ()),
    "reconstruction.grid_step_m": ("0.001", ()),
    "score.sample_step_m": ("0.001", ()),
    "sensors.sample_step_m": ("1e-9", ("fidelity=ideal",)),
    "sensors.landmarks_per_m": ("1e9", ()),
    "instruments.frame_rate_hz": ("1e6", ("fidelity=vision",)),
    "imaging.width": ("1000000", ("fidelity=vision",)),
    "satellite.cell_m": ("1e-6", ()),
    "reconstruction.gp.length_scale_m": ("1e-9", ()),
    "reconstruction.field.step_m": ("1e-9", ("reconstruction.method=field",)),
    "reconstruction.emap.step_m": ("1e-9", ("reconstruction.method=emap",)),
    "reconstruction.carving.last_length_m": ("1e-9", ("reconstruction.method=carving",)),
    "scenery.step_m": ("1e-9", ("fidelity=vision",)),
    "physics.rate_hz": ("1000000000", ("fidelity=vision",)),
    "instruments.gps.rate_hz": ("1e12", ("fidelity=vision",)),
    "instruments.inertial.rate_hz": ("1e12", ("fidelity=vision",)),
    "instruments.stakes.count": ("1000000", ("fidelity=vision",)),
    "aids.stakes": ("1000000", ()),
}
WHOLE = ("imaging.width", "physics.rate_hz", "instruments.stakes.count", "aids.stakes")


@pytest.mark.parametrize("setting", LARGE)
def test_a_size_that_does_not_fit_is_refused_with_one_that_does(setting):
    value, others = LARGE[setting]
    with pytest.raises(InputError) as caught:
        check(f"{setting}={value}", *others)
    assert "\n" not in str(caught.value)
    if setting == "satellite.cell_m":  # names how many times wider
        return
    (bound,) = re.findall(
        r"(?:at most|at least|step_m =|last_length_m =|a step of|length_scale_m to|set it to) ([0-9.e+-]*[0-9])(?: or more| m or more|\.$)",
        str(caught.value),
    )
    bound = str(int(float(bound))) if setting in WHOLE else bound
    check(f"{setting}={bound}", *others)


def test_steps_too_small_to_count_coordinates_are_refused():
    for method in ("field", "emap"):
        with pytest.raises(InputError, match="too small to count coordinates"):
            check(f"reconstruction.method={method}", f"reconstruction.{method}.step_m=1e-300")


def test_fine_ground_over_too_large_an_area_asks_for_a_smaller_one():
    mission = validated(MissionConfig, with_overrides(MISSION, ["fidelity=vision"]), "the test")
    with pytest.raises(InputError, match="choose a smaller area"):
        require_survey(mission, (0.0, 0.0, 5000.0, 5000.0))


def test_integers_of_more_than_64_bits_are_refused():
    for swaths in ("1" + "0" * 400, "1" * 5000, str(2**63)):
        with pytest.raises(ConfigError, match="planner"):
            check(f"planner.swaths={swaths}")


@pytest.mark.parametrize(
    "settings",
    [
        ("reconstruction.rays=true",),
        ("reconstruction.method=carving",),
        ("reconstruction.method=field", "reconstruction.field.rays=true"),
    ],
)
def test_a_sensor_without_lines_of_sight_is_refused_where_the_map_needs_them(settings):
    with pytest.raises(ConfigError, match="the ideal fidelity samples the ground where it stands"):
        check("fidelity=ideal", *settings)
    check("fidelity=statistical", *settings)
