"""Comparison of rendered with photographed ice: contrast, gradients, features and match lengths.

The glacier paper compares its simulator with field images by what algorithms make of them
(Figs. 3 and 4). Here: what CLAHE does for features on rendered snow of 3 % local contrast,
how far apart images may be taken, and whether a rendered debris-covered tongue has the
statistics of photographs of one. The renderer's settings are chosen on the photographs of
one camera and judged on those of the other, with other seeds.
"""

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import astuple
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from matplotlib.figure import Figure

from papers.glacier.image_measures import METHODS, clahe, relative_corners
from papers.glacier.photographs import compare_with_photographs, write_picture, write_rows
from papers.glacier.snow_scenes import SKIES, SnowScene, at_contrast
from survey.core.arrays import Progress
from survey.core.files.writing import replacing
from survey.data.camera.frames import Image
from survey.figures.style import CLAIM, ESTIMATE, FULL_IN, MUTED, png_bytes, styled

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
    write_picture(folder / "snow.png", _side_by_side([scene.frame(0)[0] for scene in scenes.values()]))
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


def _side_by_side(images: Sequence[Image]) -> Image:
    """Return images as taken (left) and after CLAHE (right), one below the other."""
    pairs = [np.hstack([image, clahe(image)])[80:] for image in images[:3]]
    return np.vstack([cv2.resize(pair, (720, 225), interpolation=cv2.INTER_AREA) for pair in pairs])


def _write_figure(path: Path, figure: Figure) -> None:
    with replacing(path) as draft:
        draft.write_bytes(png_bytes(figure))
