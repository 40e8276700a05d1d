import numpy as np
import pytest

from planners import LawnmowerConfig
from sim.config.mission import AreaConfig, MissionConfig
from sim.config.world import DemTerrain, RandomTerrain, SampleTerrain, SatelliteConfig
from sim.world.site import build_world
from survey import ConfigError, Dem, Grid, InputError
from survey.core.crs import projected_crs
from survey.core.transformation import transformed

CRS = "EPSG:32608"
CRS_BESIDE = projected_crs("EPSG:32609", "the test")


def mission(terrain, **sections) -> MissionConfig:
    return MissionConfig(
        schema_version=1, name="m", seed=4, terrain=terrain, planner=LawnmowerConfig(swaths=2), **sections
    )


def test_random_site_has_its_relief_and_a_prior_of_block_means():
    world = build_world(
        mission(RandomTerrain(source="random", step_m=3.0), satellite=SatelliteConfig(sigma_m=0.0))
    )
    assert world.terrain.relief_m == pytest.approx(25.0)
    assert world.prior.shape == (8, 8)
    assert world.area.bounds == (526000.0, 6478000.0, 526600.0, 6478600.0)
    assert world.prior.bounds == world.area.bounds
    inner = world.terrain.window((526300.0, 6478300.0, 526375.0, 6478375.0))
    # Nodes on the cell's rim count by half in the block mean, fully in this plain mean.
    assert world.prior.at([[526337.5, 6478337.5]])[0] == pytest.approx(inner.elevation.mean(), abs=0.02)


def test_satellite_errs_by_its_sigma():
    quiet = build_world(
        mission(RandomTerrain(source="random", step_m=3.0), satellite=SatelliteConfig(sigma_m=0.0))
    ).prior
    noisy = build_world(
        mission(RandomTerrain(source="random", step_m=3.0), satellite=SatelliteConfig(sigma_m=2.0))
    ).prior
    error = noisy.elevation - quiet.elevation
    # 64 draws: the sample's standard deviation errs by 9 %, thrice that allowed.
    assert error.std() == pytest.approx(2.0, rel=0.27)


def test_the_sample_site_is_600_m_of_real_ridge():
    world = build_world(mission(SampleTerrain(source="srtm-sample", step_m=3.0)))
    xmin, ymin, xmax, ymax = world.area.bounds
    assert (xmax - xmin, ymax - ymin) == pytest.approx((600.0, 600.0))
    assert world.prior.shape == (8, 8)
    assert 20.0 < world.prior.relief_m < 30.0
    assert world.terrain.vertical_datum == "EGM96 height"


def hilly(step_m: float = 3.0, n: int = 100) -> Dem:
    grid = Grid((0.0, 0.0, step_m * (n - 1), step_m * (n - 1)), step_m, CRS)
    x, y = np.meshgrid(grid.x, grid.y)
    return Dem.on(grid, 100.0 + 5.0 * np.sin(x / 40.0) * np.cos(y / 30.0))


def test_coarse_raster_as_prior_gets_a_fine_surface_with_its_means(tmp_path):
    grid = Grid((0.0, 0.0, 700.0, 700.0), 70.0, CRS)
    x, y = np.meshgrid(grid.x, grid.y)
    Dem.on(grid, 0.02 * x + 3.0 * np.cos(y / 200.0)).write(tmp_path / "coarse.tif")
    terrain = DemTerrain(source="dem", file=str(tmp_path / "coarse.tif"), role="prior", step_m=5.0)
    world = build_world(mission(terrain, area=AreaConfig(bounds_m=(140.0, 140.0, 560.0, 560.0))))
    assert world.terrain.step_m == 5.0
    assert world.prior.step_m == 70.0
    centre = world.terrain.window((315.0, 315.0, 385.0, 385.0)).elevation.mean()
    assert centre == pytest.approx(world.prior.at([[350.0, 350.0]])[0], abs=0.05)


def test_nodata_in_the_area_is_refused_or_cut_off_on_request(tmp_path):
    dem = hilly()
    elevation = dem.elevation.copy()
    elevation[:, 70:] = np.nan
    Dem(elevation, dem.transform, dem.crs).write(tmp_path / "half.tif")
    terrain = DemTerrain(source="dem", file=str(tmp_path / "half.tif"))
    satellite = SatelliteConfig(cell_m=75.0)
    with pytest.raises(InputError, match=r"30\.0 % of the survey area has no known terrain"):
        build_world(mission(terrain, satellite=satellite))
    world = build_world(mission(terrain, satellite=satellite, area=AreaConfig(clip_to_terrain=True)))
    assert world.area.bounds[2] < 70 * 3.0
    assert np.isfinite(world.terrain.at(np.array(world.area.polygon.exterior.coords))).all()
    assert np.isfinite(world.prior.elevation).all()


def test_satellite_cells_must_be_whole_fine_cells(tmp_path):
    hilly().write(tmp_path / "a.tif")
    terrain = DemTerrain(source="dem", file=str(tmp_path / "a.tif"))
    with pytest.raises(InputError, match=r"satellite.cell_m = 51"):
        build_world(mission(terrain, satellite=SatelliteConfig(cell_m=50.5)))


def test_micro_relief_lies_on_top_and_leaves_the_rest():
    plain = build_world(mission(RandomTerrain(source="random", step_m=2.0))).terrain
    icy = build_world(mission(RandomTerrain(source="random", step_m=2.0, micro_relief_sd_m=0.4))).terrain
    # One draw of a field of some 300 × 300 m² per correlation area: its standard deviation within 15 %.
    assert (icy.elevation - plain.elevation).std() == pytest.approx(0.4, rel=0.15)


def test_a_satellite_of_a_class_of_products_has_its_offset_and_more():
    terrain = RandomTerrain(source="random", step_m=3.0)
    plain, high = (
        build_world(mission(terrain, satellite=satellite)).prior.elevation
        for satellite in (SatelliteConfig(sigma_m=1.0), SatelliteConfig(sigma_m=1.0, datum_sigma_m=5.0))
    )
    np.testing.assert_allclose(high - plain, (high - plain)[0, 0], atol=1e-9)
    assert abs((high - plain)[0, 0]) > 0.1
    product = build_world(mission(terrain, satellite=SatelliteConfig(product="srtm-90"))).prior.elevation
    # White and correlated errors of 2 and 3 m.
    assert 1.0 < (product - plain).std() < 8.0


def test_a_mission_has_real_terrain_and_a_prior_of_another_resolution_and_crs(tmp_path):
    fine = Grid((500000.0, 6478000.0, 500400.0, 6478400.0), 4.0, CRS)
    truth = Dem.on(fine, 0.05 * (fine.xy[:, 0] - 500000.0).reshape(fine.shape), "EGM96 height")
    truth.write(tmp_path / "truth.tif")
    # The neighbouring zone: turned by 5 degrees, 6 degrees of longitude away.
    there = transformed(np.array([[500200.0, 6478200.0]]), truth.crs, CRS_BESIDE, "the test")[0]
    coarse = Grid((there[0] - 900.0, there[1] - 900.0, there[0] + 900.0, there[1] + 900.0), 30.0, CRS_BESIDE)
    here = transformed(coarse.xy, CRS_BESIDE, truth.crs, "the test")
    prior = Dem.on(coarse, 0.05 * (here[:, 0] - 500000.0).reshape(coarse.shape) + 2.0, "EGM96 height")
    prior.write(tmp_path / "prior.tif")
    asked = mission(
        DemTerrain(source="dem", file="truth.tif"),
        satellite=SatelliteConfig(file="prior.tif"),
        area=AreaConfig(bounds_m=(500050.0, 6478050.0, 500350.0, 6478350.0)),
    ).read_from(tmp_path)
    world = build_world(asked)
    assert world.prior.crs == world.terrain.crs
    assert world.prior.step_m == pytest.approx(30.0)
    places = np.array([[500100.0, 6478100.0], [500300.0, 6478320.0]])
    np.testing.assert_allclose(world.prior.at(places) - world.terrain.at(places), 2.0, atol=0.02)
    assert set(asked.input_files) == {"terrain.file", "satellite.file"}


def test_a_prior_elsewhere_is_refused(tmp_path):
    fine = Grid((500000.0, 6478000.0, 500400.0, 6478400.0), 4.0, CRS)
    Dem.on(fine, np.zeros(fine.shape)).write(tmp_path / "truth.tif")
    other = Grid((500000.0, 6478000.0, 500200.0, 6478400.0), 40.0, CRS)
    Dem.on(other, np.zeros(other.shape)).write(tmp_path / "prior.tif")
    asked = mission(DemTerrain(source="dem", file="truth.tif"), satellite=SatelliteConfig(file="prior.tif"))
    with pytest.raises(InputError, match="take a raster that covers it"):
        build_world(asked.read_from(tmp_path))
    with pytest.raises(ConfigError, match="makes the terrain's raster the prior"):
        mission(
            DemTerrain(source="dem", file="truth.tif", role="prior"), satellite=SatelliteConfig(file="p.tif")
        )


def test_equal_missions_in_two_folders_and_after_a_change_have_their_own_terrain(tmp_path, monkeypatch):
    heights_m = []
    config = mission(DemTerrain(source="dem", file="dem.tif", role="truth"))
    low = hilly()
    for folder, raised_m in (("one", 0.0), ("two", 100.0), ("two", 200.0)):
        (tmp_path / folder).mkdir(exist_ok=True)
        monkeypatch.chdir(tmp_path / folder)
        Dem(low.elevation + raised_m, low.transform, low.crs).write("dem.tif")
        heights_m.append(build_world(config).terrain.elevation.mean())
    np.testing.assert_allclose(np.diff(heights_m), 100.0)
