"""Areas, volumes and masses of one scene are the same in every projection."""

import numpy as np
import pytest
import shapely

from benchmarks.map_scale import (
    BAR,
    PROJECTIONS,
    RADIUS_M,
    VOLUME_M3,
    largest_differences,
    measured,
    sunken_lake,
)
from survey import Dem, Grid
from survey.core.map_scale import scale_factors
from survey.scoring import change
from survey.scoring.differencing.change_files import change_facts

NORTH, FAR_NORTH, SOUTH = (-123.3, 61.0), (-45.0, 76.0), (-62.0, -64.5)
SCENES = [
    ("EPSG:32610", NORTH),
    ("EPSG:3857", NORTH),
    ("EPSG:3413", NORTH),
    ("EPSG:3031", NORTH),
    ("EPSG:3413", FAR_NORTH),
    ("EPSG:3857", FAR_NORTH),
    ("EPSG:3031", SOUTH),
    ("EPSG:32720", SOUTH),
    ("EPSG:3857", SOUTH),
]


@pytest.mark.parametrize(("crs", "centre"), SCENES, ids=[f"{crs} at {place[1]:g}" for crs, place in SCENES])
def test_a_volume_is_that_of_the_ground(crs: str, centre: tuple[float, float]) -> None:
    found = sunken_lake(crs, centre).volumes[0]
    # 0.3 % is the bar; 28,000 cells of 0.01 m, and the count of cells in the disc, leave less.
    assert found.volume_m3 == pytest.approx(VOLUME_M3, rel=0.003)
    assert found.area_m2 == pytest.approx(np.pi * RADIUS_M**2, rel=0.001)
    assert found.std_m3 < 0.003 * abs(VOLUME_M3)


def test_volume_area_and_length_agree_between_every_two_projections() -> None:
    differences = largest_differences({crs: measured(crs) for crs in PROJECTIONS})
    assert len(differences) == 6
    assert max(value for pair in differences.values() for value in pair.values()) < BAR


def test_intervals_and_correlation_lengths_do_not_depend_on_the_projection() -> None:
    utm, mercator = (sunken_lake(crs, NORTH) for crs in ("EPSG:32610", "EPSG:3857"))
    assert mercator.volumes[0].naive_std_m3 == pytest.approx(utm.volumes[0].naive_std_m3, rel=0.02)
    assert utm.variogram is not None
    assert mercator.variogram is not None
    assert mercator.variogram.variance_m2 == pytest.approx(utm.variogram.variance_m2, rel=0.02)


def test_a_correlation_length_is_that_of_the_ground() -> None:
    rng = np.random.default_rng(6)
    north_m = 8_500_000.0
    factor = float(scale_factors("EPSG:3857", [[0.0, north_m]]).linear[0])
    ranges: list[float] = []
    for crs, step in (("EPSG:3857", 20.0 * factor), ("EPSG:32631", 20.0)):
        centre = (0.0, north_m) if crs == "EPSG:3857" else (500_000.0, 6_700_000.0)
        grid = Grid.over((centre[0], centre[1], centre[0] + 99 * step, centre[1] + 99 * step), step, crs)
        if not ranges:
            blocks = np.kron(rng.normal(0.0, 1.0, (20, 20)), np.ones((5, 5)))
        earlier = Dem.on(grid, np.zeros(grid.shape))
        outline = {"corner": shapely.box(*centre, centre[0] + 10 * step, centre[1] + 10 * step)}
        found = change(Dem.on(grid, blocks), earlier, outline).variogram
        assert found is not None
        ranges.append(max(structure.range_m for structure in found.structures))
    assert ranges[0] == pytest.approx(ranges[1], rel=0.01)


def test_the_result_states_the_map_scale_and_warns() -> None:
    facts = change_facts(sunken_lake("EPSG:3857", NORTH))
    assert facts["map_scale"]["linear"]["mean"] == pytest.approx(2.06, abs=0.01)
    assert facts["map_scale"]["areal"]["min"] < facts["map_scale"]["areal"]["max"]
    assert any("times those on the ground" in note for note in facts["notes"])
    assert not any("times those" in note for note in change_facts(sunken_lake("EPSG:32610", NORTH))["notes"])


def test_masses_follow_the_volumes() -> None:
    utm, mercator = (sunken_lake(crs, NORTH).volumes[0].mass() for crs in ("EPSG:32610", "EPSG:3857"))
    assert mercator.mass_kg == pytest.approx(utm.mass_kg, rel=0.003)
    assert mercator.specific_m_we == pytest.approx(utm.specific_m_we, rel=0.003)
