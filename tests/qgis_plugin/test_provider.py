"""Provider of QGIS: its table names options that the commands have, and its algorithms run in QGIS where it is installed."""

import json
import subprocess
import sys
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path

import pytest
from typer.main import get_command

from firnline.cli.main import app
from survey import Dem, Route
from tests.docs.scratch import make_scratch
from tests.survey.reporting.qgis_check import qgis_python

PLUGIN = Path(__file__).parents[2] / "qgis_plugin"
# Arguments are the folder of the plugin, the program, and a JSON file of calls. Prints the results, texts of errors among them.
RUN_IN_QGIS = """
import json
import sys
from pathlib import Path

from qgis.core import QgsApplication, QgsProcessingException

APP = QgsApplication([], False)
APP.initQgis()
sys.path[:0] = [f"{QgsApplication.pkgDataPath()}/python/plugins", sys.argv[1]]

import processing
from firnline_processing.provider import PLACE, Plugin
from processing.core.Processing import Processing
from processing.core.ProcessingConfig import ProcessingConfig

Processing.initialize()
plugin = Plugin()
plugin.initProcessing()
ProcessingConfig.setSettingValue(PLACE, sys.argv[2])
results = []
for name, parameters in json.loads(Path(sys.argv[3]).read_text(encoding="utf-8")):
    try:
        results.append(processing.run(f"firnline:{name}", parameters))
    except QgsProcessingException as error:
        results.append(str(error))
names = [one.id() for one in QgsApplication.processingRegistry().providerById("firnline").algorithms()]
plugin.unload()
print(json.dumps({"names": names, "results": results}))
"""


def table():
    spec = spec_from_file_location("commands", PLUGIN / "firnline_processing" / "commands.py")
    module = module_from_spec(spec)
    spec.loader.exec_module(module)
    return module.COMMANDS


@pytest.mark.parametrize("command", table(), ids=lambda command: command.name)
def test_every_option_of_the_table_is_one_of_the_command(command):
    known = get_command(app).commands[command.words[0]].params
    options = {name for one in known for name in one.opts if name.startswith("-")}
    output = () if command.output is None else (command.output.option,)
    used = {*(one.option for one in command.inputs), *command.flags, *output} - {""}
    assert used <= options


@pytest.fixture(scope="module")
def found(tmp_path_factory):
    """Return what QGIS prints for one call of each algorithm and two that are refused, and the folder."""
    python = qgis_python()
    if python is None:
        pytest.skip("QGIS with its Python interface is not installed (Debian: python3-qgis)")
    folder = tmp_path_factory.mktemp("qgis")
    make_scratch(folder)
    at = {name: str(folder / name) for name in (
        "site.gpkg", "srtm.tif", "landmarks.csv", "map.tif", "lidar.tif", "gnss.csv", "2024.tif", "2026.tif", "glacier.gpkg",
        "route.gpkg", "mapped", "changed", "route.plan",
    )}  # fmt: skip
    calls = [
        ("plan", {"SITE": at["site.gpkg"], "PRIOR": at["srtm.tif"], "SWATHS": 4, "OUTPUT": at["route.gpkg"]}),
        ("exportroute", {"ROUTE": at["route.gpkg"], "AREA": at["site.gpkg"], "DEM": at["srtm.tif"], "OUTPUT": at["route.plan"]}),
        ("reconstruct", {"POINTS": at["landmarks.csv"], "GRID": 30, "CRS": "EPSG:32608", "OUTPUT": at["mapped"]}),
        ("scoreraster", {"MAP": at["map.tif"], "TRUTH": at["lidar.tif"]}),
        ("scorecheckpoints", {"MAP": at["map.tif"], "CHECKPOINTS": at["gnss.csv"]}),
        ("change", {"LATER": at["2026.tif"], "EARLIER": at["2024.tif"], "OUTLINE": at["glacier.gpkg"], "OUTPUT": at["changed"]}),
        ("plan", {"SITE": at["site.gpkg"], "SWATHS": -2, "OUTPUT": str(folder / "none.gpkg")}),
    ]  # fmt: skip
    (folder / "calls.json").write_text(json.dumps(calls), encoding="utf-8")
    program = Path(sys.executable).with_name("firnline")
    words = [
        python,
        "-c",
        RUN_IN_QGIS,
        str(PLUGIN),
        str(program),
        str(folder / "calls.json"),
    ]
    environment = {
        "QT_QPA_PLATFORM": "offscreen",
        "PATH": "/usr/bin:/bin",
        "HOME": str(folder),
        "PYTHONDONTWRITEBYTECODE": "1",
    }
    ended = subprocess.run(words, capture_output=True, text=True, check=True, env=environment)
    return folder, json.loads(ended.stdout.strip().splitlines()[-1])


@pytest.mark.long
def test_all_algorithms_run_in_qgis(found):
    folder, said = found
    assert said["names"] == sorted(f"firnline:{command.name}" for command in table())
    plan, export, mapped, scored, checked, changed, _ = said["results"]
    assert Route.read(folder / "route.gpkg").n_rovers == 1
    assert "4 swaths" in plan["SUMMARY"]
    assert Path(export["OUTPUT"]).name == "route.plan"
    assert json.loads((folder / "route.plan").read_text())["fileType"] == "Plan"
    assert Dem.read(Path(mapped["OUTPUT"]) / "dem.tif").step_m == 30.0
    assert "cm class" in scored["SUMMARY"]
    assert "36" in checked["SUMMARY"]
    assert Dem.read(Path(changed["OUTPUT"]) / "change.tif").step_m == 10.0


@pytest.mark.long
def test_a_refusal_is_the_sentence_of_the_command(found):
    folder, said = found
    assert said["results"][-1].startswith("firnline: ")
    assert not (folder / "none.gpkg").exists()
