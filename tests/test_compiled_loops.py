"""Compiled loops round alike in the process that compiles them and in one that loads them stored.

numba compiles an inner function alone, and once more within the function that calls it. A process that compiles calls
the first copy, one that loads stored functions the second. Where operations may be reordered or fused, the two differ in
their last bits.
"""

import importlib
import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType

import pytest
from numba.core.registry import CPUDispatcher

ROOT = Path(__file__).parents[1]
SAFE = {"nnan", "ninf", "nsz"}


def _modules() -> Iterator[ModuleType]:
    for package in ("survey", "vision_slam", "planners", "sim"):
        for file in sorted((ROOT / package).rglob("*.py")):
            if "njit" in file.read_text() or "rendering.compiled" in file.read_text():
                yield importlib.import_module(".".join(file.relative_to(ROOT).with_suffix("").parts))


def _compiled(module: ModuleType) -> dict[str, CPUDispatcher]:
    return {name: f for name, f in vars(module).items() if isinstance(f, CPUDispatcher)}


def _may_round_otherwise(function: CPUDispatcher) -> bool:
    flags = function.targetoptions.get("fastmath", False)
    return flags is True or bool(set(flags or ()) - SAFE)


def test_functions_that_others_call_are_inlined_or_keep_the_order_of_their_operations() -> None:
    calls = [
        (caller, called[name])
        for module in _modules()
        for called in [_compiled(module)]
        for caller in called.values()
        for name in caller.py_func.__code__.co_names
        if name in called
    ]
    assert len(calls) > 100  # the test finds them
    wrong = {
        f"{inner.py_func.__module__}.{inner.py_func.__qualname__}"
        for _, inner in calls
        if _may_round_otherwise(inner) and inner.targetoptions.get("inline") != "always"
    }
    assert not wrong


_VIEW = """
import hashlib
import numpy as np
from sim.config.world import AppearanceConfig, ImagingConfig, SceneryConfig
from sim.rendering import Renderer
from sim.simulate.assembly import rover_camera
from sim.world.fine_terrain import fine_terrain
from survey.data.dem import Dem
from survey.data.grid import Grid

grid = Grid((0.0, 0.0, 120.0, 120.0), 1.0)
x, y = np.meshgrid(grid.x, grid.y)
hills = Dem.on(grid, 5.0 * np.sin(x / 17.0) * np.cos(y / 23.0))
ground = fine_terrain(hills, SceneryConfig(crevasses_per_ha=1.0, pools_per_ha=1.0), seed=77)
renderer = Renderer(ground, AppearanceConfig(), rover_camera(ImagingConfig()), 77)
camera = np.array([[0.0, -0.3, 0.95, 0.0], [-1.0, 0.0, 0.0, 0.0], [0.0, -0.95, -0.3, 0.0], [0.0, 0.0, 0.0, 1.0]])
for place in (20.0, 60.0, 100.0):
    camera[:3, 3] = place, 50.0, ground.elevation(np.array([[place, 50.0]]))[0] + 1.0
    radiance, _ = renderer.trace(camera, None, None, shaded=True)
    print(hashlib.sha256(radiance.tobytes()).hexdigest())
"""


@pytest.mark.long
def test_views_have_the_same_bytes_with_fresh_and_with_stored_loops(tmp_path: Path) -> None:
    environment = os.environ | {"NUMBA_CACHE_DIR": str(tmp_path), "NUMBA_NUM_THREADS": "1"}
    command = [sys.executable, "-c", _VIEW]
    first, second = (
        subprocess.run(command, cwd=ROOT, env=environment, capture_output=True, text=True, check=True).stdout
        for _ in range(2)
    )
    assert first.count("\n") == 3
    assert first == second
