"""What QGIS makes of a project, by its Python interface in a process of its own."""

import json
import shutil
import subprocess
from pathlib import Path

# Prints the CRS of the project that is named, and validity and renderer of each of its layers.
OPEN_IN_QGIS = """
import json, sys
from qgis.core import QgsApplication, QgsProject
app = QgsApplication([], False)
app.initQgis()
project = QgsProject.instance()
assert project.read(sys.argv[1])
layers = {l.name(): [l.isValid(), l.renderer().type()] for l in project.mapLayers().values()}
print(json.dumps([project.crs().authid(), layers]))
app.exitQgis()
"""


def qgis_python() -> str | None:
    """Return a Python that has QGIS; Debian installs it for its own one."""
    return next((p for p in ("/usr/bin/python3", shutil.which("python3")) if p and _has_qgis(p)), None)


def layers_in_qgis(python: str, project: Path) -> tuple[str, dict[str, tuple[bool, str]]]:
    """Return the CRS of a project, and of each layer by name whether it is valid and its renderer."""
    environment = {"QT_QPA_PLATFORM": "offscreen", "PATH": "/usr/bin:/bin", "HOME": str(project.parent)}
    ended = subprocess.run(
        [python, "-c", OPEN_IN_QGIS, str(project)],
        capture_output=True,
        text=True,
        check=True,
        env=environment,
    )
    crs, layers = json.loads(ended.stdout.strip().splitlines()[-1])
    return crs, layers


def _has_qgis(python: str) -> bool:
    done = subprocess.run([python, "-c", "import qgis.core"], capture_output=True, check=False)
    return done.returncode == 0
