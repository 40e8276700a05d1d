"""Structure of the packages: imports, the contents of the wheel, the cost of ``--help``."""

import ast
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
PACKAGES = ("firnline", "survey", "planners", "vision_slam", "sim", "live", "desk", "papers")


def imported_by(file: Path) -> set[str]:
    tree = ast.parse(file.read_text(encoding="utf-8"))
    names = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            names |= {alias.name.split(".")[0] for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{file} has a relative import"
            names.add((node.module or "").split(".")[0])
    return names


@pytest.mark.parametrize("package", ["survey", "planners", "vision_slam"])
def test_lower_packages_import_neither_the_simulator_nor_pybullet(package):
    allowed = {
        "survey": {"survey"},
        "planners": {"planners", "survey"},
        "vision_slam": {"vision_slam", "survey"},
    }[package]
    for file in (ROOT / package).rglob("*.py"):
        assert not imported_by(file) & (set(PACKAGES) - allowed | {"pybullet"}), file


def test_every_package_can_be_imported_first():
    # A circular import shows when another package comes first. The children share the packages of others.
    probe = (
        "import importlib, os, sys, traceback\n"
        "import cv2, matplotlib.figure, numba, pydantic, pyproj, rasterio, scipy.optimize, scipy.spatial, shapely\n"
        "for package in sys.argv[1:]:\n"
        "    if os.fork() == 0:\n"
        "        try:\n"
        "            module = importlib.import_module(package)\n"
        "            [getattr(module, name) for name in getattr(module, '__all__', ())]\n"
        "        except BaseException:\n"
        "            traceback.print_exc()\n"
        "            os._exit(1)\n"
        "        os._exit(0)\n"
        "    assert os.wait()[1] == 0, package"
    )
    subprocess.run([sys.executable, "-c", probe, *PACKAGES], check=True, cwd=ROOT)


def test_the_wheel_owns_exactly_the_packages(tmp_path):
    builder = "from hatchling.build import build_wheel; import sys; build_wheel(sys.argv[1])"
    subprocess.run([sys.executable, "-c", builder, str(tmp_path)], check=True, cwd=ROOT, capture_output=True)
    (wheel,) = tmp_path.glob("*.whl")
    with zipfile.ZipFile(wheel) as archive:
        names = archive.namelist()
    owned = {name.split("/")[0] for name in names if ".dist-info/" not in name}
    assert owned == set(PACKAGES)
    stubs = ("firnline", "survey", "survey/reconstruction", "planners", "vision_slam")
    assert {f"{package}/__init__.pyi" for package in stubs} <= set(names)
    assert any(name.endswith(".dist-info/licenses/LICENSE") for name in names)
    assert "sim/examples/short_drive.toml" in names
    assert "desk/static/vendor/ol/ol.js" in names
    assert any(name.startswith("survey/reporting/") and name.endswith((".html", ".j2")) for name in names)


def test_help_starts_without_heavy_packages():
    probe = (
        "import sys; sys.argv = ['firnline', '--help']\n"
        "from firnline.__main__ import main\n"
        "try:\n    main()\nexcept SystemExit:\n    pass\n"
        "heavy = {'numpy', 'scipy', 'matplotlib', 'rasterio', 'pydantic', 'shapely'} & set(sys.modules)\n"
        "assert not heavy, heavy"
    )
    subprocess.run([sys.executable, "-c", probe], check=True, capture_output=True, cwd=ROOT)


def test_every_benchmark_can_be_imported():
    probe = (
        "import pkgutil, sys, importlib, benchmarks\n"
        "for module in pkgutil.walk_packages(benchmarks.__path__, 'benchmarks.'):\n"
        "    importlib.import_module(module.name)"
    )
    subprocess.run([sys.executable, "-c", probe], check=True, capture_output=True, cwd=ROOT)


def test_every_test_that_the_gate_leaves_out_exists() -> None:
    lines = (ROOT / "tests" / "exhaustive.txt").read_text().splitlines()
    for line in (line for line in lines if not line.startswith("#")):
        file, _, name = line.partition("::")
        assert f"def {name.partition('[')[0]}(" in (ROOT / file).read_text(), line
