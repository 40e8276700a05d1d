"""Rendered bare ice and debris beside photographs of such ground, by the image measures of Fig. 4.

The settings of each surface are chosen on the photographs of one camera and judged on those of the other, with other
seeds: two cameras on opposite sides of one glacier (Belvedere), four dates each. Regions are named by hand: debris without
snow, and the dusty face of the ice cliff. No photograph of clean snow near the camera is to be had, nor of a second glacier.
The only snow is that of the first date, which lies in patches on the debris; it has no settings of its own.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np

from benchmarks.report import Row, main
from papers.glacier.images import (
    CHOSEN_ON,
    JUDGED_ON,
    Region,
    SnowScene,
    ground_region,
    misfit,
    patch_statistics,
    photographs,
    spread,
    verdicts,
)
from sim.config.world import AppearanceConfig, SceneryConfig

_PATCH_PX = 80
_CHOOSING_SEED, _JUDGING_SEED = 310, 410
_WITHOUT_SNOW, _WITH_SNOW, _ALWAYS = (1, 2, 3), (0,), (0, 1, 2, 3)


@dataclass(frozen=True)
class Surface:
    """Kind of ground: its scenery, and where photographs show it.

    `regions`: of each camera, with the numbers of the photographs. `least`: bar of the measures within.
    """

    name: str
    scenery: SceneryConfig
    regions: dict[str, list[tuple[Region, tuple[int, ...]]]]
    least: int | None = None


_SETTINGS = {"contrast": (0.7, 0.85, 1.0), "sky_share": (0.45, 0.6)}
"""Settings of the appearance that are tried."""


def _scenery(surface: str, snow_cover: float = 0.0) -> SceneryConfig:
    return SceneryConfig.model_validate(
        {"surface": surface, "snow_cover": snow_cover, "crevasses_per_ha": 0.0, "pools_per_ha": 0.0}
    )


DEBRIS = Surface(
    "debris",
    _scenery("debris"),
    {
        "cam1": [
            ((x, y, r, b), _WITHOUT_SNOW)
            for x, y, r, b in ((0, 330, 640, 427), (480, 190, 640, 330), (160, 150, 320, 200))
        ],
        "cam2": [((x, y, r, b), _WITHOUT_SNOW) for x, y, r, b in ((80, 100, 560, 235), (300, 330, 480, 420))],
    },
    12,
)
BARE_ICE = Surface(
    "bare and dirty ice",
    _scenery("bare ice"),
    {
        "cam1": [((300, 200, 560, 260), _ALWAYS), ((210, 260, 450, 335), _ALWAYS)],
        "cam2": [((330, 240, 490, 315), _ALWAYS), ((90, 310, 250, 375), _ALWAYS)],
    },
    12,
)
PATCHY = Surface(
    "patches of snow on debris", _scenery("debris", 0.5), {"cam2": [((160, 80, 560, 235), _WITH_SNOW)]}
)


def rows(quick: bool) -> Iterator[Row]:
    """Yield the measures within the photographs' spread, and each measure."""
    yield Row.of("photographs of clean snow, without which 13 of 16 cannot be judged", 0.0, "1", ">=", 1.0)
    seen = {camera: photographs(camera) for camera in (CHOSEN_ON, JUDGED_ON)}
    if not all(seen.values()):
        return
    chosen: dict[str, float] = {}
    for surface in (DEBRIS, PATCHY, BARE_ICE):
        if surface.regions.get(CHOSEN_ON):
            chosen = _choose(surface, _spread_of(surface, CHOSEN_ON, seen), quick=quick)
        bounds, n = _spread_of(surface, JUDGED_ON, seen)
        found = list(verdicts(_rendered(surface, chosen, _JUDGING_SEED, 1 if quick else 4), bounds))
        within = sum(row["within"] for row in found)
        name = f"{surface.name}: measures within the spread of {n} patches of photographs, of {len(found)}"
        yield (
            Row(name, within, "1")
            if surface.least is None
            else Row.of(name, within, "1", ">=", surface.least)
        )
        for setting, value in chosen.items():
            yield Row(f"{surface.name}: {setting}, chosen on the other camera", value, "1")
        for row in found:
            outside = "" if row["within"] else ", outside"
            low, high = row["photographs_p5"], row["photographs_p95"]
            yield Row(
                f"{surface.name}: {row['measure']}, photographs {low:g} to {high:g}{outside}",
                row["rendered_median"],
                "1",
            )


def _spread_of(
    surface: Surface, camera: str, seen: dict[str, list]
) -> tuple[dict[str, tuple[float, float, float]], int]:
    """Return the spread of the measures over a camera's patches, and the number of these."""
    shown = [(seen[camera][k], region) for region, numbers in surface.regions[camera] for k in numbers]
    patches = patch_statistics(shown, _PATCH_PX)
    return spread(patches), len(patches)


def _choose(
    surface: Surface, known: tuple[dict[str, tuple[float, float, float]], int], *, quick: bool
) -> dict[str, float]:
    """Return the settings whose images are nearest to the photographs."""
    grid = [dict(zip(_SETTINGS, values, strict=True)) for values in product(*_SETTINGS.values())]
    misfits = [
        misfit(_rendered(surface, one, _CHOOSING_SEED, 1), known[0]) for one in grid[:: 3 if quick else 1]
    ]
    return grid[int(np.argmin(misfits))]


def _rendered(surface: Surface, settings: dict[str, float], seed: int, n_frames: int) -> dict[str, float]:
    """Return the median of each measure over the patches of rendered frames."""
    look = AppearanceConfig.model_validate({"sun_elevation_deg": 45.0, **settings})
    scene = SnowScene(look, seed, scenery=surface.scenery)
    frames: Sequence = [ground_region(*scene.frame(drive)) for drive in range(n_frames)]
    patches = patch_statistics(frames, _PATCH_PX)
    return {name: float(np.median([patch[name] for patch in patches])) for name in patches[0]}


if __name__ == "__main__":
    main("Simulator realism", rows, packages=("numpy", "numba", "opencv-python-headless"))
