"""QGIS projects: groups, relative paths, renderers, and that QGIS opens them where it is installed."""

import zipfile
from pathlib import Path
from xml.etree import ElementTree as ET

import numpy as np
import pytest
import rasterio
import shapely

from survey import Dem, Grid, Reconstruction, Route, SurveyArea
from survey.data.route import Leg
from survey.reporting.qgis import QgisGroup, QgisLayer, write_project
from tests.survey.reporting.qgis_check import layers_in_qgis, qgis_python

CRS = "EPSG:32608"
GRID = Grid((526_000.0, 6_478_000.0, 526_200.0, 6_478_100.0), 10.0, CRS)
RENDERERS = {
    "Route": "categorizedSymbol",
    "Starts": "singleSymbol",
    "Survey area": "categorizedSymbol",
    "Standard deviation": "singlebandpseudocolor",
    "Support": "paletted",
    "Hillshade": "hillshade",
    "Elevation": "singlebandpseudocolor",
}


@pytest.fixture
def project(tmp_path: Path) -> Path:
    data = tmp_path / "data"
    data.mkdir()
    terrain = Dem.on(GRID, GRID.xy[:, 0].reshape(GRID.shape) - 526_000.0)
    support = (np.arange(terrain.elevation.size) % 4).astype(np.uint8).reshape(terrain.shape)
    std = Dem(np.full(terrain.shape, 0.4), terrain.transform, CRS)
    Reconstruction(terrain, std, support, "gp", {}).write(data)
    zone = shapely.box(526_050.0, 6_478_040.0, 526_060.0, 6_478_050.0)
    area = SurveyArea(shapely.box(*GRID.bounds), CRS, (zone,), [[526_010.0, 6_478_010.0]])
    area.write(data / "area.gpkg")
    legs = [Leg("swath", [[526_000.0, 6_478_020.0 + k], [526_200.0, 6_478_020.0 + k]], k) for k in (0, 1)]
    Route(tuple(legs), CRS, "lawnmower").write(data / "route.gpkg")
    plan = (
        QgisLayer("Starts", data / "area.gpkg", "starts", table="area"),
        QgisLayer("Route", data / "route.gpkg", "route", table="route", n_rovers=2),
        QgisLayer("Survey area", data / "area.gpkg", "area", table="area"),
    )
    maps = (
        QgisLayer("Support", data / "support.tif", "support", is_visible=False),
        QgisLayer("Standard deviation", data / "dem.tif", "deviation", 2, (0.0, 0.5)),
        QgisLayer("Hillshade", data / "dem.tif", "hillshade"),
        QgisLayer("Elevation", data / "dem.tif", "elevation", limits=(0.0, 200.0)),
    )
    groups = (QgisGroup("Plan", plan), QgisGroup("Map", maps))
    write_project(tmp_path / "run.qgz", "a run", groups, terrain.crs, area.bounds)
    return tmp_path / "run.qgz"


def content(project: Path) -> ET.Element:
    with zipfile.ZipFile(project) as archive:
        assert archive.namelist() == ["run.qgs"]
        return ET.fromstring(archive.read("run.qgs"))


def test_layers_stand_in_groups_with_paths_relative_to_the_project(project):
    root = content(project)
    groups = root.findall("layer-tree-group/layer-tree-group")
    assert [group.get("name") for group in groups] == ["Plan", "Map"]
    assert root.findtext("properties/Paths/Absolute") == "false"
    ids = {layer.findtext("id") for layer in root.iter("maplayer")}
    assert {leaf.get("id") for leaf in root.iter("layer-tree-layer")} == ids
    assert len(ids) == 7
    for layer in root.iter("maplayer"):
        file = layer.findtext("datasource").split("|")[0]
        assert file.startswith("./data/")
        assert (project.parent / file).is_file()
        assert layer.findtext("srs/spatialrefsys/authid") == CRS
    # QGIS takes no notice of a project's CRS without this.
    assert root.findtext("properties/SpatialRefSys/ProjectionsEnabled") == "1"
    checked = {leaf.get("name"): leaf.get("checked") for leaf in root.iter("layer-tree-layer")}
    assert checked["Support"] == "Qt::Unchecked"


def test_every_layer_has_its_renderer(project):
    found = {}
    for layer in content(project).iter("maplayer"):
        renderer = layer.find("pipe/rasterrenderer")
        renderer = layer.find("renderer-v2") if renderer is None else renderer
        found[layer.findtext("layername")] = renderer.get("type")
    assert found == RENDERERS


def test_routes_have_arrows_and_a_symbol_for_each_rover(project):
    layer = next(one for one in content(project).iter("maplayer") if one.findtext("layername") == "Route")
    categories = {one.get("value"): one.get("label") for one in layer.iter("category")}
    assert categories["swath 1"] == "Rover 2, swaths"
    assert len(categories) == 4
    symbols = {one.get("name") for one in layer.findall("renderer-v2/symbols/symbol")}
    assert {one.get("symbol") for one in layer.iter("category")} == symbols
    assert sum(one.get("class") == "MarkerLine" for one in layer.iter("layer")) == 2


def test_the_standard_deviation_is_the_second_band_from_zero(project):
    layer = next(
        one for one in content(project).iter("maplayer") if one.findtext("layername") == "Standard deviation"
    )
    renderer = layer.find("pipe/rasterrenderer")
    assert (renderer.get("band"), renderer.get("classificationMin"), renderer.get("classificationMax")) == (
        "2",
        "0",
        "0.5",
    )
    values = [float(item.get("value")) for item in layer.iter("item")]
    assert values == sorted(values)
    assert len(set(values)) == 9


def test_support_is_bytes_with_names_of_its_categories(project):
    file = project.parent / "data" / "support.tif"
    with rasterio.open(file) as raster:
        assert raster.dtypes == ("uint8",)
        assert raster.nodata is None
    names = [one.text for one in ET.parse(f"{file}.aux.xml").iter("Category")]
    assert names == ["Unseen", "Interpolated", "Ray-bounded", "Measured"]
    assert set(np.unique(Reconstruction.read(file.parent).support)) == {0, 1, 2, 3}


def test_the_same_project_has_the_same_bytes(project):
    before = project.read_bytes()
    crs, layer = GRID.crs, QgisLayer("Hillshade", project.parent / "data" / "dem.tif", "hillshade")
    for name in ("a.qgz", "b.qgz"):
        write_project(project.parent / name, "x", (QgisGroup("g", (layer,)),), crs, GRID.bounds)
    assert before == project.read_bytes()
    a, b = (zipfile.ZipFile(project.parent / f"{n}.qgz").read(f"{n}.qgs") for n in "ab")
    assert a == b


def test_qgis_opens_every_layer_with_its_renderer(project):
    python = qgis_python()
    if python is None:
        pytest.skip("QGIS with its Python interface is not installed (Debian: python3-qgis)")
    crs, layers = layers_in_qgis(python, project)
    assert crs == CRS
    assert all(is_valid for is_valid, _ in layers.values())
    assert {name: kind for name, (_, kind) in layers.items()} == RENDERERS
