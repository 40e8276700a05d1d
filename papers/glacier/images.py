"""Comparison of rendered with photographed ice: contrast, gradients, features and match lengths.

The glacier paper compares its simulator with field images by what algorithms make of them
(Figs. 3 and 4). Here: what CLAHE does for features on rendered snow of 3 % local contrast,
how far apart images may be taken, and whether a rendered debris-covered tongue has the
statistics of photographs of one. The renderer's settings are chosen on the photographs of
one camera and judged on those of the other, with other seeds. A `SnowScene` renders pairs of
frames along a line. The image measures stand first, the figures last.
"""

import csv
import json
import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import astuple, dataclass, field
from functools import cached_property
from itertools import product
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt
from matplotlib.figure import Figure

from sim.config.world import AppearanceConfig, ImagingConfig, SceneryConfig
from sim.rendering import Renderer
from sim.simulate.assembly import rover_camera
from sim.world.fine_terrain import fine_terrain
from survey.core import FloatArray, Progress, replacing, stream
from survey.data.frames import Image, read_image
from survey.data.grid import Grid
from survey.figures.style import CLAIM, DPI, ESTIMATE, FULL_IN, MUTED, png_bytes, styled
from survey.terrain.random_fields import squared_exponential_field

Mask = npt.NDArray[np.bool_]

_opencv: Any = cv2  # its stubs do not know what these functions take and give
LOCAL_SIGMA_PX = 12.0
CORNER_STRENGTH = 2e-4
"""Least eigenvalue of a corner, as the visual odometry asks for it: 1.8 grey levels per pixel in the weakest direction."""
_WINDOW_PX = 5
_SPACING_PX = 7


def clahe(image: Image) -> Image:
    """Equalise the histogram tile by tile with a limit on contrast (8 × 8 tiles, clip 4)."""
    return np.asarray(cv2.createCLAHE(4.0, (8, 8)).apply(image), dtype=np.uint8)


def rms_contrast(image: Image, mask: Mask) -> float:
    """Divide the standard deviation of the grey levels by their mean."""
    return float(image[mask].std() / image[mask].mean())


def local_contrast(image: Image, mask: Mask) -> float:
    """Return the median over the image of standard deviation over mean under a Gaussian window of 12 pixels."""
    weight = _smooth(mask.astype(np.float32)) + 1e-6
    level = np.where(mask, image, 0).astype(np.float32)
    mean = _smooth(level) / weight
    variance = np.maximum(_smooth(level * level) / weight - mean * mean, 0.0)
    return float(np.median((np.sqrt(variance) / np.maximum(mean, 1.0))[mask]))


def _smooth(values: npt.NDArray[np.float32]) -> npt.NDArray[np.float32]:
    return np.asarray(cv2.GaussianBlur(values, (0, 0), LOCAL_SIGMA_PX), dtype=np.float32)


def gradients(image: Image, mask: Mask) -> FloatArray:
    """Return the lengths of the gradient [grey levels per pixel] at the masked pixels."""
    derivatives = [cv2.Sobel(image, cv2.CV_32F, *axis, ksize=3) / 8.0 for axis in ((1, 0), (0, 1))]
    return np.asarray(np.hypot(*derivatives)[mask], dtype=np.float64)


def entropy_bits(image: Image, mask: Mask) -> float:
    """Return the entropy of the histogram of grey levels."""
    share = np.bincount(image[mask], minlength=256) / mask.sum()
    return float(-(share[share > 0] * np.log2(share[share > 0])).sum())


def corners(image: Image, mask: Mask) -> FloatArray:
    """Shi and Tomasi's corners above an absolute threshold, at most one in 7 × 7 pixels, (N, 2)."""
    return _peaks(_opencv.cornerMinEigenVal(image, _WINDOW_PX), CORNER_STRENGTH, mask)


def harris_corners(image: Image, mask: Mask) -> FloatArray:
    """Return Harris's corners (k = 0.04) above the same threshold, squared as his measure is."""
    return _peaks(_opencv.cornerHarris(image, _WINDOW_PX, 3, 0.04), CORNER_STRENGTH**2, mask)


def relative_corners(image: Image, mask: Mask) -> FloatArray:
    """Shi and Tomasi's corners as they are often found: above 1 % of the image's best; `mask` is applied afterwards."""
    found = cv2.goodFeaturesToTrack(image, 3000, 0.01, _SPACING_PX, blockSize=_WINDOW_PX)
    places: FloatArray = np.zeros((0, 2)) if found is None else found[:, 0].astype(np.float64)
    u, v = np.rint(places).astype(int).T
    inside: FloatArray = places[mask[v, u]]
    return inside


def _peaks(strength: npt.NDArray[np.float32], threshold: float, mask: Mask) -> FloatArray:
    highest = cv2.dilate(strength, np.ones((_SPACING_PX, _SPACING_PX), np.uint8))
    v, u = np.nonzero((strength >= highest) & (strength > threshold) & mask)
    return np.column_stack([u, v]).astype(np.float64)


@dataclass(frozen=True)
class Pair:
    """Two images, and where the first one's pixels are in the second."""

    first: Image
    second: Image
    flow: FloatArray
    """(H, W, 2) [pixels]."""
    mask: Mask
    """Terrain of the first image that is visible in the second."""

    def equalised(self) -> "Pair":
        """Return the pair after CLAHE."""
        return Pair(clahe(self.first), clahe(self.second), self.flow, self.mask)

    def correct(self, start: FloatArray, end: FloatArray, within_px: float = 2.0) -> int:
        """Count the matches that end where the flow says."""
        if len(start) == 0:
            return 0
        u, v = np.rint(start).astype(int).T
        error = np.linalg.norm(end - start - self.flow[v, u], axis=1)
        return int((error < within_px).sum())


def tracked(pair: Pair, start: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Follow places by Lucas and Kanade's method forwards and back; keep those that return within a pixel."""
    if len(start) == 0:
        return start, start
    points = start.astype(np.float32)[:, None]
    window = {"winSize": (21, 21), "maxLevel": 4}
    end, ahead, _ = _opencv.calcOpticalFlowPyrLK(pair.first, pair.second, points, None, **window)
    back, again, _ = _opencv.calcOpticalFlowPyrLK(pair.second, pair.first, end, None, **window)
    tracked = (ahead.ravel() == 1) & (again.ravel() == 1)
    tracked &= np.linalg.norm((back - points)[:, 0], axis=1) < 1.0
    return start[tracked], end[tracked, 0].astype(np.float64)


def described(
    pair: Pair, detector: "cv2.Feature2D", norm: int, ratio: float
) -> tuple[int, FloatArray, FloatArray]:
    """Detect and match by descriptors: mutual nearest neighbours that beat the second nearest by a ratio."""
    first, words = detector.detectAndCompute(pair.first, pair.mask.astype(np.uint8) * 255)
    second, others = detector.detectAndCompute(pair.second, None)
    if len(first) < 2 or len(second) < 2:
        return len(first), np.zeros((0, 2)), np.zeros((0, 2))
    matcher = cv2.BFMatcher(norm)
    ahead = [
        two[0] for two in matcher.knnMatch(words, others, k=2) if two[0].distance < ratio * two[1].distance
    ]
    back = {match.queryIdx: match.trainIdx for match in matcher.match(others, words)}
    pairs = [(m.queryIdx, m.trainIdx) for m in ahead if back.get(m.trainIdx) == m.queryIdx]
    start = np.array([first[i].pt for i, _ in pairs], dtype=np.float64).reshape(-1, 2)
    end = np.array([second[k].pt for _, k in pairs], dtype=np.float64).reshape(-1, 2)
    return len(first), start, end


@dataclass(frozen=True)
class Yield:
    """Counts of one method on one pair."""

    detected: int
    matched: int
    correct: int


def by_tracking(detect: Callable[[Image, Mask], FloatArray]) -> Callable[[Pair], Yield]:
    """Return the method that detects corners and tracks them."""

    def method(pair: Pair) -> Yield:
        found = detect(pair.first, pair.mask)
        start, end = tracked(pair, found)
        return Yield(len(found), len(start), pair.correct(start, end))

    return method


def by_orb(pair: Pair) -> Yield:
    """Return corners by ORB with its default, absolute threshold of 20 grey levels."""
    found, start, end = described(pair, cv2.ORB.create(3000), cv2.NORM_HAMMING, 0.9)
    return Yield(found, len(start), pair.correct(start, end))


def by_sift(pair: Pair) -> Yield:
    """Return corners by SIFT with its default, absolute threshold on contrast."""
    found, start, end = described(pair, cv2.SIFT.create(), cv2.NORM_L2, 0.8)
    return Yield(found, len(start), pair.correct(start, end))


METHODS: dict[str, Callable[[Pair], Yield]] = {
    "GFTT + KLT": by_tracking(corners),
    "Harris + KLT": by_tracking(harris_corners),
    "ORB": by_orb,
    "SIFT": by_sift,
    "GFTT + KLT, relative threshold": by_tracking(relative_corners),
}


def statistics(image: Image, mask: Mask) -> dict[str, float]:
    """Return the measures by which rendered images are compared with photographs, features per megapixel."""
    megapixels = mask.sum() / 1e6
    slopes = gradients(image, mask)
    grey = np.percentile(image[mask], [5, 50, 95])
    values = {
        "RMS contrast": rms_contrast(image, mask),
        "local contrast": local_contrast(image, mask),
        "gradient, median": float(np.median(slopes)),
        "gradient, 90th percentile": float(np.quantile(slopes, 0.9)),
        "gradient, 90th over 50th": float(np.quantile(slopes, 0.9) / max(np.median(slopes), 0.1)),
        "grey levels, 5th to 95th": float(grey[2] - grey[0]),
        "skew of grey levels": float((grey[2] - 2.0 * grey[1] + grey[0]) / max(grey[2] - grey[0], 1.0)),
        "entropy": entropy_bits(image, mask),
    }
    for suffix, picture in (("", image), (" after CLAHE", clahe(image))):
        values["GFTT" + suffix] = len(corners(picture, mask)) / megapixels
        values["Harris" + suffix] = len(harris_corners(picture, mask)) / megapixels
        byte_mask = mask.astype(np.uint8) * 255
        values["ORB" + suffix] = len(cv2.ORB.create(20000).detect(picture, byte_mask)) / megapixels
        values["SIFT" + suffix] = len(cv2.SIFT.create().detect(picture, byte_mask)) / megapixels
    return values


SIDE_M = 160.0
LOW_CONTRAST = 0.03
"""Local contrast of wind-worked snow."""

SKIES: dict[str, dict[str, Any]] = {
    "clear, sun at 25°": {},
    "clear, sun at 18° from the side": {"sun_elevation_deg": 18.0, "sun_from_deg": 140.0},
    "clear, sun at 45°": {"sun_elevation_deg": 45.0},
    "thin cloud": {"sky_share": 0.7},
    "overcast, no mountains": {"sky_share": 1.0, "ridges_deg": 0.0},
    "haze, clean snow": {"debris": 0.0, "haze_m": 500.0},
}
"""Name → how it differs from the default appearance."""


@dataclass(frozen=True)
class SnowScene:
    """A small site under one sky, seen by the default camera.

    `look`: light and surface. `seed`: of ground, texture and noise. `imaging`: the camera. `scenery`: the
    ground's relief; without crevasses unless said.
    """

    look: AppearanceConfig
    seed: int
    imaging: ImagingConfig = field(default_factory=ImagingConfig)
    scenery: SceneryConfig = field(default_factory=lambda: SceneryConfig(crevasses_per_ha=0.0))

    @cached_property
    def renderer(self) -> Renderer:
        """The scene as the camera sees it."""
        grid = Grid((0.0, 0.0, SIDE_M, SIDE_M), 1.0)
        terrain = squared_exponential_field(
            grid, stream(self.seed, "terrain"), relief_m=6.0, length_scale_m=110.0
        )
        ground = fine_terrain(terrain, self.scenery, self.seed)
        return Renderer(
            ground,
            self.look,
            rover_camera(self.imaging),
            self.seed,
            imaging=self.imaging,
            wind_from_deg=self.scenery.wind_from_deg,
        )

    def pose(self, drive: int, along_m: float = 0.0) -> FloatArray:
        """Return T_world_camera on the drive of this number, so far along its straight line."""
        rng = stream(self.seed, "drive", drive)
        yaw, start = rng.uniform(0.0, 2.0 * np.pi), rng.uniform(0.3 * SIDE_M, 0.7 * SIDE_M, 2)
        ahead = np.array([np.cos(yaw), np.sin(yaw)])
        place = (start + along_m * ahead)[None]
        # The rover lies level across a metre of ground, not on one cell.
        around = place + 0.4 * np.array([[1, 1], [1, -1], [-1, 1], [-1, -1]])
        up = self.renderer.terrain.normal(around).mean(axis=0)
        up /= np.linalg.norm(up)
        left = np.cross(up, [*ahead, 0.0])
        left /= np.linalg.norm(left)
        T_world_body = np.eye(4)
        T_world_body[:3, :3] = np.column_stack([np.cross(left, up), left, up])
        T_world_body[:3, 3] = *place[0], self.renderer.terrain.elevation(around).mean()
        return T_world_body @ self.renderer.camera.T_body_camera

    def frame(self, drive: int, along_m: float = 0.0) -> tuple[Image, Mask]:
        """Return the image there and which of its pixels are ground."""
        pose = self.pose(drive, along_m)
        number = 1000 * drive + round(100.0 * along_m)
        return self.renderer.render(pose, frame_index=number), np.isfinite(self.renderer.depth(pose))

    def pair(self, drive: int, apart_m: float = 0.25) -> Pair:
        """Return two frames some way apart on a drive, with the exact motion between them."""
        first, second = self.pose(drive), self.pose(drive, apart_m)
        images = self.frame(drive)[0], self.frame(drive, apart_m)[0]
        flow, seen = self.renderer.flow(first, second), self.renderer.visible(first, second)
        return Pair(*images, flow, seen & np.isfinite(flow).all(axis=-1))

    def ground_contrast(self, n_drives: int = 3) -> float:
        """Return the local contrast of the ground, median over drives."""
        return float(np.median([local_contrast(*self.frame(drive)) for drive in range(n_drives)]))


def at_contrast(sky: Mapping[str, Any], seed: int, wanted: float = LOW_CONTRAST) -> SnowScene:
    """Return a scene under a sky whose texture is as strong as gives the wanted local contrast."""
    contrast = 1.0
    for _ in range(4):
        scene = SnowScene(AppearanceConfig(**{**sky, "contrast": contrast}), seed)
        found = scene.ground_contrast()
        if abs(found - wanted) < 0.05 * wanted:
            break
        contrast *= float(np.clip((wanted / found) ** 1.3, 0.3, 3.0))
    return scene


CHOSEN_ON, JUDGED_ON = "cam1", "cam2"
CREDIT = "Photographs: Belvedere Glacier, franioli/icepy4d, BSD-3-Clause"
_CHOOSING_SEED, _JUDGING_SEED = 300, 400
# Rows of the photographs that show the glacier and its debris, as shares of the height.
_GLACIER_ROWS = {"cam1": (0.45, 1.0), "cam2": (0.40, 0.85)}
_PATCH_PX = 160
# Noise in images makes large files.
_IMAGES_DPI = 100
_GRID: dict[str, tuple[float, ...]] = {
    "contrast": (1.0, 1.3, 1.6),
    "sky_share": (0.5, 0.75, 1.0),
}


def compare_with_photographs(folder: Path, *, quick: bool, progress: Progress) -> dict[str, Any]:
    """Choose the renderer's settings on one camera's photographs, judge them on the other's."""
    found = {camera: photographs(camera) for camera in (CHOSEN_ON, JUDGED_ON)}
    if not all(found.values()):
        return {"compared": False, "reason": "photos_ice_glacier was not found; set FIRNLINE_DATA."}
    spreads = {camera: spread(_patches(camera, images)) for camera, images in found.items()}
    grid = [dict(zip(_GRID, values, strict=True)) for values in product(*_GRID.values())]
    misfits = []
    for number, settings in enumerate(grid[:: 4 if quick else 1]):
        progress("choosing the debris on one camera's photographs", number, len(grid))
        misfits.append((misfit(_rendered(settings, _CHOOSING_SEED, 2)[0], spreads[CHOSEN_ON]), settings))
    best = min(misfits, key=lambda found: found[0])[1]
    values, images = _rendered(best, _JUDGING_SEED, 2 if quick else 6)
    rows = list(verdicts(values, spreads[JUDGED_ON]))
    write_rows(folder / "photographs.csv", rows)
    _write_figure(folder / "photographs.png", photographs_figure(found[JUDGED_ON], images), _IMAGES_DPI)
    return {
        "compared": True,
        "chosen": best,
        "chosen on": CHOSEN_ON,
        "judged on": JUDGED_ON,
        "within": sum(row["within"] for row in rows),
        "of": len(rows),
        "pictures": f"photographs.png. {CREDIT}.",
    }


def photographs(camera: str) -> list[Image]:
    """Return the photographs of one camera as the rover's camera sees, in the order of their dates; none without the data."""
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
    return patch_statistics(
        [(i, (0, round(top * len(i)), i.shape[1], round(bottom * len(i)))) for i in images], _PATCH_PX
    )


Region = tuple[int, int, int, int]
"""Left, top, right and bottom of a part of an image [pixels]; right and bottom are excluded."""


def patch_statistics(regions: Sequence[tuple[Image, Region]], side_px: int) -> list[dict[str, float]]:
    """Measure the square patches of regions; those at the right and the bottom are at least half as long."""
    found = []
    for image, (left, top, right, bottom) in regions:
        for y in range(top, bottom - 1 - side_px // 2, side_px):
            for x in range(left, right - 1 - side_px // 2, side_px):
                patch = np.zeros(image.shape, bool)
                patch[y : min(y + side_px, bottom), x : min(x + side_px, right)] = True
                found.append(statistics(image, patch))
    return found


def ground_region(image: Image, mask: Mask) -> tuple[Image, Region]:
    """Return an image with the region of its rows that show the ground alone."""
    rows = np.flatnonzero(mask.mean(axis=1) > 0.99)
    return image, (0, int(rows[0]), image.shape[1], int(rows[-1]) + 1)


def spread(patches: Sequence[Mapping[str, float]]) -> dict[str, tuple[float, float, float]]:
    """Return the 5th, 50th and 95th percentile of every measure."""
    return {
        name: tuple(np.percentile([patch[name] for patch in patches], [5, 50, 95]).tolist())
        for name in patches[0]
    }


def _rendered(
    settings: Mapping[str, float], seed: int, n_frames: int
) -> tuple[dict[str, float], list[Image]]:
    """Return the median statistics of patches of rendered debris-covered ice, and the images."""
    look = AppearanceConfig.model_validate({**settings, "stones": 1.0, "patches": 2.0, "haze_m": 2000.0})
    scene = SnowScene(look, seed, ImagingConfig(gain=255.0))
    images = [scene.frame(drive) for drive in range(n_frames)]
    patches = patch_statistics([ground_region(*frame) for frame in images], _PATCH_PX)
    return {name: float(np.median([p[name] for p in patches])) for name in patches[0]}, [i for i, _ in images]


def misfit(values: Mapping[str, float], bounds: Mapping[str, tuple[float, float, float]]) -> float:
    """Return the mean distance from the photographs' medians, in halves of their spread."""
    return float(
        np.mean([abs(values[n] - mid) / max(high - low, 1e-9) for n, (low, mid, high) in bounds.items()])
    )


def verdicts(
    values: Mapping[str, float], bounds: Mapping[str, tuple[float, float, float]]
) -> Iterator[dict[str, Any]]:
    """Yield each measure with the photographs' spread, and whether it lies within."""
    for name, (low, middle, high) in bounds.items():
        yield {
            "measure": name,
            "rendered_median": round(values[name], 4),
            "photographs_p5": round(low, 4),
            "photographs_median": round(middle, 4),
            "photographs_p95": round(high, 4),
            "within": bool(low <= values[name] <= high),
        }


def write_rows(path: Path, rows: Sequence[Mapping[str, Any]]) -> None:
    """Write mappings with equal keys as a CSV table."""
    with replacing(path) as draft, draft.open("w", encoding="utf-8", newline="") as file:
        writer = csv.DictWriter(file, list(rows[0]), lineterminator="\n")
        writer.writeheader()
        writer.writerows(rows)


BASELINES_M = 0.1, 0.25, 0.5, 1.0, 2.0, 4.0
_FIRST_SEED = 100


def glacier_fig4(folder: Path, *, quick: bool, progress: Progress) -> None:
    """Write the tables and pictures of the comparison into a folder.

    Photographs are read from ``photos_ice_glacier`` in the folder that the environment
    variable FIRNLINE_DATA names (default ``../shared/data``); without them the comparison
    with photographs is left out, and ``summary.json`` says so.
    """
    skies = dict(list(SKIES.items())[: 2 if quick else None])
    scenes = {}
    for number, (name, sky) in enumerate(skies.items()):
        progress("snow of 3 % contrast under several skies", number, len(skies))
        scenes[name] = at_contrast(sky, _FIRST_SEED + number)
    rows = list(_clahe_rows(scenes, 2 if quick else 4, progress))
    write_rows(folder / "clahe.csv", rows)
    lengths = list(_baseline_rows(scenes, 1 if quick else 2, progress))
    write_rows(folder / "match_length.csv", lengths)
    _write_figure(folder / "clahe.png", clahe_figure(rows, lengths))
    _write_figure(folder / "snow.png", snow_figure(scenes), _IMAGES_DPI)
    summary = {
        "local contrast": {name: round(scene.ground_contrast(), 4) for name, scene in scenes.items()},
        "gain in correct matches": gains(rows),
        "corners on snow, relative threshold": {
            name: mountain_trap(scene) for name, scene in scenes.items() if scene.look.ridges_deg > 0.0
        },
        "photographs": compare_with_photographs(folder, quick=quick, progress=progress),
    }
    with replacing(folder / "summary.json") as draft:
        draft.write_text(json.dumps(summary, indent=2, ensure_ascii=False) + "\n", encoding="utf-8")


# ------------------------------------------------------------------ what CLAHE does


def _clahe_rows(
    scenes: Mapping[str, SnowScene], n_pairs: int, progress: Progress
) -> Iterator[dict[str, Any]]:
    for number, (name, scene) in enumerate(scenes.items()):
        progress("features before and after CLAHE", number, len(scenes))
        yield from clahe_yields(name, scene, n_pairs)


def clahe_yields(
    name: str, scene: SnowScene, n_pairs: int, apart_m: float = 0.25
) -> Iterator[dict[str, Any]]:
    """Count detections, matches and correct matches of every method, summed over pairs, raw and after CLAHE."""
    total = {(method, image): np.zeros(3, int) for method in METHODS for image in ("raw", "CLAHE")}
    for drive in range(n_pairs):
        raw = scene.pair(drive, apart_m)
        for image, pair in (("raw", raw), ("CLAHE", raw.equalised())):
            for method, measure in METHODS.items():
                total[method, image] += astuple(measure(pair))
    for (method, image), (detected, matched, correct) in total.items():
        yield {
            "scene": name,
            "method": method,
            "image": image,
            "baseline_m": apart_m,
            "pairs": n_pairs,
            "detected": int(detected),
            "matched": int(matched),
            "correct": int(correct),
        }


def gains(rows: Sequence[Mapping[str, Any]]) -> dict[str, dict[str, float]]:
    """Return correct matches after CLAHE over before, per method: all pairs together, the median and the worst scene."""
    correct = {(row["scene"], row["method"], row["image"]): row["correct"] for row in rows}
    scenes = sorted({row["scene"] for row in rows})
    result = {}
    for method in METHODS:
        raw, equalised = ([correct[scene, method, image] for scene in scenes] for image in ("raw", "CLAHE"))
        ratios = [after / max(before, 1) for before, after in zip(raw, equalised, strict=True)]
        result[method] = {
            "together": round(sum(equalised) / max(sum(raw), 1), 2),
            "median scene": round(float(np.median(ratios)), 2),
            "worst scene": round(min(ratios), 2),
        }
    return result


def mountain_trap(scene: SnowScene, n_frames: int = 4) -> dict[str, int]:
    """Count corners on snow by a relative threshold, with the mountains in the image and with them painted over."""
    counts = {"with mountains": 0, "mountains painted over": 0}
    for drive in range(n_frames):
        image, ground = scene.frame(drive)
        inner = cv2.erode(ground.astype(np.uint8), np.ones((15, 15), np.uint8)).astype(bool)
        covered = np.where(ground, image, np.uint8(np.median(image[ground])))
        soft = cv2.GaussianBlur(covered, (0, 0), 6.0)
        covered = np.where(inner, covered, soft)
        counts["with mountains"] += len(relative_corners(image, inner))
        counts["mountains painted over"] += len(relative_corners(covered, inner))
    return counts


def _baseline_rows(
    scenes: Mapping[str, SnowScene], n_pairs: int, progress: Progress
) -> Iterator[dict[str, Any]]:
    name, scene = next(iter(scenes.items()))
    for number, apart_m in enumerate(BASELINES_M):
        progress("matches over the distance between images", number, len(BASELINES_M))
        yield from clahe_yields(name, scene, n_pairs, apart_m)


@styled
def clahe_figure(rows: Sequence[Mapping[str, Any]], lengths: Sequence[Mapping[str, Any]]) -> Figure:
    """Draw correct matches per pair before and after CLAHE, and over the distance between the images."""
    figure = Figure(figsize=(FULL_IN, 3.8), layout="constrained")
    bars, curves = figure.subplots(1, 2)
    for shift, image, colour in ((-0.2, "raw", MUTED), (0.2, "CLAHE", ESTIMATE)):
        mean = [
            np.mean([r["correct"] / r["pairs"] for r in rows if (r["method"], r["image"]) == (method, image)])
            for method in METHODS
        ]
        bars.bar(np.arange(len(METHODS)) + shift, np.maximum(mean, 0.1), 0.38, color=colour, label=image)
    bars.set_xticks(
        range(len(METHODS)), [name.replace(", ", ",\n") for name in METHODS], rotation=30, ha="right"
    )
    bars.set(yscale="log", ylabel="correct matches per pair", title="Snow of 3 % contrast, 0.25 m apart")
    bars.legend()
    for method, colour in zip(("GFTT + KLT", "ORB", "SIFT"), (ESTIMATE, CLAIM, MUTED), strict=True):
        for image, dashes in (("raw", ":"), ("CLAHE", "-")):
            chosen = [r for r in lengths if (r["method"], r["image"]) == (method, image)]
            counts = [max(r["correct"] / r["pairs"], 0.5) for r in chosen]
            places = [r["baseline_m"] for r in chosen]
            curves.plot(places, counts, dashes, color=colour, marker=".", label=f"{method}, {image}")
    curves.set(
        xscale="log", yscale="log", xlabel="distance between the images [m]", title="How far matches last"
    )
    curves.legend(ncols=2)
    return figure


@styled
def snow_figure(scenes: Mapping[str, SnowScene]) -> Figure:
    """Draw rendered snow under three skies, as taken and after CLAHE, with its corners."""
    shown = dict(list(scenes.items())[:3])
    figure, rows = _rows_of_images(len(shown))
    for axes, (name, scene) in zip(rows, shown.items(), strict=True):
        image, ground = scene.frame(0)
        for place, what, picture in zip(axes, ("as taken", "CLAHE"), (image, clahe(image)), strict=True):
            found = corners(picture, ground)
            place.imshow(picture[80:], cmap="gray", vmin=0, vmax=255)
            place.plot(*(found - [0.0, 80.0]).T, ".", markersize=1.2, color=ESTIMATE)
            place.set_title(f"{name}, {what}: {len(found)} corners", fontsize=8)
    return figure


@styled
def photographs_figure(taken: Sequence[Image], rendered: Sequence[Image]) -> Figure:
    """Draw photographs of debris-covered ice beside rendered ice, as the paper's Fig. 4 does."""
    pairs = list(zip(taken, rendered, strict=False))[:3]
    figure, rows = _rows_of_images(len(pairs))
    for axes, pair in zip(rows, pairs, strict=True):
        for place, what, picture in zip(axes, ("photograph", "rendered"), pair, strict=True):
            place.imshow(picture[-320:], cmap="gray", vmin=0, vmax=255)
            place.set_title(what, fontsize=8)
    figure.supxlabel(CREDIT, fontsize=7)
    return figure


def _rows_of_images(n_rows: int) -> tuple[Figure, Any]:
    """Return a figure of rows of two images without axes."""
    figure = Figure(figsize=(FULL_IN, 2.3 * n_rows), layout="constrained")
    rows = figure.subplots(n_rows, 2, squeeze=False)
    for axes in rows.flat:
        axes.set_axis_off()
    return figure, rows


def _write_figure(path: Path, figure: Figure, dpi: int = DPI) -> None:
    with replacing(path) as draft:
        draft.write_bytes(png_bytes(figure, dpi))
