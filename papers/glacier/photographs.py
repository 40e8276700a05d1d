"""Comparison of rendered debris-covered ice with photographs: settings chosen on one camera, judged on another."""

import csv
import os
from collections.abc import Iterator, Mapping, Sequence
from itertools import product
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from papers.glacier.image_measures import Mask, statistics
from papers.glacier.snow_scenes import SnowScene
from sim.config.scene import AppearanceConfig, ImagingConfig
from survey.core.arrays import Progress
from survey.core.files.writing import replacing
from survey.data.camera.frames import Image, read_image

CHOSEN_ON, JUDGED_ON = "cam1", "cam2"
CREDIT = "Photographs: Belvedere Glacier, franioli/icepy4d, BSD-3-Clause"
_CHOOSING_SEED, _JUDGING_SEED = 300, 400
# Rows of the photographs that show the glacier and its debris, as shares of the height.
_GLACIER_ROWS = {"cam1": (0.45, 1.0), "cam2": (0.40, 0.85)}
_PATCH_PX = 160
_GRID: dict[str, tuple[float, ...]] = {
    "contrast": (1.0, 1.3, 1.6),
    "sky_share": (0.5, 0.75, 1.0),
}


def compare_with_photographs(folder: Path, *, quick: bool, progress: Progress) -> dict[str, Any]:
    """Choose the renderer's settings on one camera's photographs, judge them on the other's."""
    photographs = {camera: _photographs(camera) for camera in (CHOSEN_ON, JUDGED_ON)}
    if not all(photographs.values()):
        return {"compared": False, "reason": "photos_ice_glacier was not found; set FIRNLINE_DATA."}
    spread = {camera: _spread(_patches(camera, images)) for camera, images in photographs.items()}
    grid = [dict(zip(_GRID, values, strict=True)) for values in product(*_GRID.values())]
    misfits = []
    for number, settings in enumerate(grid[:: 4 if quick else 1]):
        progress("choosing the debris on one camera's photographs", number, len(grid))
        misfits.append((_misfit(_rendered(settings, _CHOOSING_SEED, 2)[0], spread[CHOSEN_ON]), settings))
    best = min(misfits, key=lambda found: found[0])[1]
    values, images = _rendered(best, _JUDGING_SEED, 2 if quick else 6)
    rows = list(_verdicts(values, spread[JUDGED_ON]))
    write_rows(folder / "photographs.csv", rows)
    write_picture(folder / "photographs.png", _comparison(photographs[JUDGED_ON], images))
    return {
        "compared": True,
        "chosen": best,
        "chosen on": CHOSEN_ON,
        "judged on": JUDGED_ON,
        "within": sum(row["within"] for row in rows),
        "of": len(rows),
        "pictures": f"photographs.png: left photographs, right rendered. {CREDIT}.",
    }


def _photographs(camera: str) -> list[Image]:
    data = Path(os.environ.get("FIRNLINE_DATA", Path(__file__).parents[3] / "shared" / "data"))
    files = sorted((data / "photos_ice_glacier" / "belvedere" / "img" / camera).glob("*.jpg"))
    return [_as_camera_sees(read_image(file)) for file in files]


def _as_camera_sees(photograph: Image, width: int = 640) -> Image:
    """Return a photograph in grey with as many columns as the rover's camera has."""
    grey = cv2.cvtColor(photograph, cv2.COLOR_BGR2GRAY)
    size = width, round(width * grey.shape[0] / grey.shape[1])
    return np.asarray(cv2.resize(grey, size, interpolation=cv2.INTER_AREA), dtype=np.uint8)


def _patches(camera: str, images: Sequence[Image]) -> list[dict[str, float]]:
    """Return the statistics of the glacier's patches in photographs."""
    top, bottom = _GLACIER_ROWS[camera]
    ground = []
    for image in images:
        mask = np.zeros(image.shape, bool)
        mask[round(top * len(image)) : round(bottom * len(image))] = True
        ground.append((image, mask))
    return _patch_statistics(ground)


def _patch_statistics(images: Sequence[tuple[Image, Mask]]) -> list[dict[str, float]]:
    """Measure square patches that are wholly on the masked ground."""
    found = []
    for image, mask in images:
        rows = np.flatnonzero(mask.mean(axis=1) > 0.99)
        for top in range(rows[0], rows[-1] - _PATCH_PX // 2, _PATCH_PX):
            for left in range(0, image.shape[1], _PATCH_PX):
                patch = np.zeros(image.shape, bool)
                patch[top : min(top + _PATCH_PX, rows[-1] + 1), left : left + _PATCH_PX] = True
                found.append(statistics(image, patch))
    return found


def _spread(patches: Sequence[Mapping[str, float]]) -> dict[str, tuple[float, float, float]]:
    """Return the 5th, 50th and 95th percentile of every measure."""
    return {
        name: tuple(np.percentile([patch[name] for patch in patches], [5, 50, 95]).tolist())
        for name in patches[0]
    }


def _rendered(
    settings: Mapping[str, float], seed: int, n_frames: int
) -> tuple[dict[str, float], list[Image]]:
    """Return the median statistics of patches of rendered debris-covered ice, and the images."""
    look = AppearanceConfig(**settings, stones=1.0, patches=2.0, haze_m=2000.0)
    scene = SnowScene(look, seed, ImagingConfig(gain=255.0))
    images = [scene.frame(drive) for drive in range(n_frames)]
    patches = _patch_statistics(images)
    return {name: float(np.median([p[name] for p in patches])) for name in patches[0]}, [i for i, _ in images]


def _misfit(values: Mapping[str, float], spread: Mapping[str, tuple[float, float, float]]) -> float:
    """Return the mean distance from the photographs' medians, in halves of their spread."""
    return float(
        np.mean([abs(values[n] - mid) / max(high - low, 1e-9) for n, (low, mid, high) in spread.items()])
    )


def _verdicts(
    values: Mapping[str, float], spread: Mapping[str, tuple[float, float, float]]
) -> Iterator[dict[str, Any]]:
    for name, (low, middle, high) in spread.items():
        yield {
            "measure": name,
            "rendered_median": round(values[name], 4),
            "photographs_p5": round(low, 4),
            "photographs_median": round(middle, 4),
            "photographs_p95": round(high, 4),
            "within": bool(low <= values[name] <= high),
        }


def _comparison(photographs: Sequence[Image], rendered: Sequence[Image]) -> Image:
    pairs = [(p[-320:, :], r[-320:, :]) for p, r in zip(photographs, rendered, strict=False)][:3]
    return np.vstack(
        [cv2.resize(np.hstack(pair), (720, 180), interpolation=cv2.INTER_AREA) for pair in pairs]
    )


def write_picture(path: Path, picture: Image) -> None:
    """Write an image as PNG."""
    with replacing(path) as draft:
        draft.write_bytes(cv2.imencode(".png", picture, [cv2.IMWRITE_PNG_COMPRESSION, 9])[1].tobytes())


def write_rows(path: Path, rows: Sequence[Mapping[str, Any]]) -> None:
    """Write mappings with equal keys as a CSV table."""
    with replacing(path) as draft, draft.open("w", encoding="utf-8", newline="") as file:
        writer = csv.DictWriter(file, list(rows[0]), lineterminator="\n")
        writer.writeheader()
        writer.writerows(rows)
