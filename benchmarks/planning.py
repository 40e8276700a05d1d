"""How fast, how short and how safe are plans of real sites: ``python -m benchmarks.planning``.

``python -m benchmarks.planning outlines`` measures the pieces of swaths on real outlines, a table of its own whose
parts are stored.
"""

import os
import sys
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import shapely
from shapely import LineString, Polygon

import planners
from benchmarks.report import Row, cpu_seconds, fastest, main
from benchmarks.stored_parts import code_digest, stored
from firnline.actions.interface import read_about
from planners.routes.fleet import share
from planners.routes.rover import Mobility, predicted
from planners.routes.shortest_paths import FreeGround
from planners.routes.tours import connect
from planners.routes.traversability import between_heights
from planners.swaths.decomposition import swaths_on, unswept
from planners.swaths.reference_lines import narrowest_heading
from survey.core.arrays import FloatArray
from survey.core.errors import InputError
from survey.core.streams import stream
from survey.data.area import SurveyArea
from survey.data.route import Leg
from survey.io.vector import read_features
from survey.reconstruction.gp.kernels import Matern32

SPACING_M = 20.0
HEADING_DEG = 90.0


def random_area(seed: int, side_m: float = 1000.0, n_zones: int = 50) -> SurveyArea:
    """Return a square with star-shaped no-go zones, 20 to 80 m across, that may touch and overlap."""
    rng = stream(seed, "planning site")
    zones = []
    for _ in range(n_zones):
        centre, n = rng.uniform(0.0, side_m, 2), int(rng.integers(5, 11))
        angle = (np.arange(n) + rng.uniform(0.1, 0.9, n)) * 2.0 * np.pi / n
        reach = rng.uniform(10.0, 40.0, n)
        zones.append(Polygon(centre + np.column_stack([reach * np.cos(angle), reach * np.sin(angle)])))
    return SurveyArea(shapely.box(0.0, 0.0, side_m, side_m), "EPSG:32608", tuple(zones))


@dataclass
class Plan:
    """The legs of every part of a site that holds a swath."""

    legs: list[Leg]
    n_swaths: int
    n_failed: int
    unswept_share: float


def planned(area: SurveyArea, spacing_m: float = SPACING_M) -> Plan:
    """Plan every part of the area that is larger than a spacing squared."""
    whole = FreeGround(area.free)
    plan = Plan([], 0, 0, 0.0)
    for part in whole.parts:
        if part.area < spacing_m**2:
            continue
        ground = whole if len(whole.parts) == 1 else FreeGround(part)
        swaths = swaths_on(ground, spacing_m, HEADING_DEG)
        plan.n_swaths += len(swaths)
        try:
            plan.legs += connect(swaths, ground)
        except InputError:
            plan.n_failed += 1
    return plan


def crossings_m(area: SurveyArea, legs: list[Leg]) -> float:
    """Return the metres of route outside the free ground: 0 exactly when every leg is covered by it."""
    lines = np.array([LineString(leg.xy) for leg in legs])
    outside = lines[~shapely.covers(area.free, lines)]
    return float(shapely.length(shapely.difference(outside, area.free)).sum())


def transit_share(legs: list[Leg]) -> float:
    swath_m = sum(leg.length_m for leg in legs if leg.kind == "swath")
    return sum(leg.length_m for leg in legs if leg.kind == "transit") / swath_m


def rows(quick: bool) -> Iterator[Row]:
    planned(random_area(-1 % 2**32, 300.0, 4))  # compile
    yield from _square_kilometre()
    yield from _many_sites(12 if quick else 100)
    yield from _four_hundred_segments()
    yield from _growth(quick)
    yield from _fleet()


def _square_kilometre() -> Iterator[Row]:
    area = random_area(0)
    plan, seconds = fastest(lambda: planned(area), 3)
    yield Row.of("1 km², 50 no-go zones, 20 m: CPU time", seconds, "s", "<=", 1.0)
    config = planners.LawnmowerConfig(spacing_m=SPACING_M, heading_deg=HEADING_DEG)
    _, seconds = fastest(lambda: planners.plan(area, None, config), 3)
    yield Row.of("1 km², from area to route with its predictions: CPU time", seconds, "s", "<=", 1.0)
    yield Row("1 km²: swaths", plan.n_swaths, "")
    ground = FreeGround(area.free)
    left = unswept(ground, swaths_on(ground, SPACING_M, HEADING_DEG), SPACING_M)
    yield Row(
        "1 km²: ground farther than 10 m from a swath",
        100.0 * sum(p.area for p in left) / area.free.area,
        "%",
    )


def _many_sites(n_sites: int) -> Iterator[Row]:
    shares, seconds, outside_m, n_outside, n_failed = [], [], 0.0, 0, 0
    for seed in range(n_sites):
        area = random_area(1000 + seed)
        plan, taken = cpu_seconds(lambda area=area: planned(area))  # type: ignore[misc]
        lines = [LineString(leg.xy) for leg in plan.legs]
        n_outside += int((~shapely.covers(area.free, lines)).sum())
        outside_m += crossings_m(area, plan.legs)
        n_failed += plan.n_failed
        shares.append(100.0 * transit_share(plan.legs))
        seconds.append(taken)
    what = f"{n_sites} sites"
    yield Row.of(f"{what}: legs that leave the free ground", n_outside, "", "<=", 0)
    yield Row.of(f"{what}: metres outside", outside_m, "m", "<=", 0.0)
    yield Row.of(f"{what}: failed detours", n_failed, "", "<=", 0)
    yield Row.of(f"{what}: transit in swath metres, mean", float(np.mean(shares)), "%", "<=", 12.0)
    yield Row.of(f"{what}: transit in swath metres, worst", float(np.max(shares)), "%", "<=", 12.0)
    yield Row.of(f"{what}: CPU time, mean", float(np.mean(seconds)), "s", "<=", 1.0)


def _four_hundred_segments() -> Iterator[Row]:
    ground = FreeGround(FreeGround(random_area(1).free).parts[0])
    swaths = swaths_on(ground, 9.5, HEADING_DEG)
    _, seconds = fastest(lambda: connect(swaths, FreeGround(ground.polygon)), 3)
    yield Row("segments routed at once", len(swaths), "")
    yield Row.of(f"{len(swaths)} segments: CPU time to order and route", seconds, "s", "<=", 1.0)


def _growth(quick: bool) -> Iterator[Row]:
    """Cost growth at a constant density of zones."""
    for area_km2, n_zones in ((2.5, 75),) if quick else ((2.5, 75), (5.0, 150), (10.0, 300)):
        area = random_area(2, 1000.0 * area_km2**0.5, n_zones)
        plan, seconds = cpu_seconds(lambda area=area: planned(area))  # type: ignore[misc]
        yield Row(f"{area_km2:g} km², {n_zones} zones: swaths", plan.n_swaths, "")
        yield Row(f"{area_km2:g} km², {n_zones} zones: CPU time", seconds, "s")
        yield Row(f"{area_km2:g} km², {n_zones} zones: CPU time per km²", seconds / area_km2, "s")
        yield Row(f"{area_km2:g} km², {n_zones} zones: transit", 100.0 * transit_share(plan.legs), "%")
        yield Row.of(f"{area_km2:g} km²: metres outside", crossings_m(area, plan.legs), "m", "<=", 0.0)


def _fleet() -> Iterator[Row]:
    """Round trips from a corner of 600 × 600 m, 30 swaths; time is distance at 1 m/s."""
    ground = FreeGround(shapely.box(0.0, 0.0, 600.0, 600.0))
    swaths = swaths_on(ground, 20.0, HEADING_DEG)
    mobility = Mobility(turn_s=0.0)

    def makespan_s(n_rovers: int) -> float:
        return predicted(share(swaths, ground, _corner(n_rovers), mobility=mobility), mobility)["time_s"]

    alone = makespan_s(1)
    for n_rovers in (2, 3, 4, 6):
        speed_up = alone / makespan_s(n_rovers)
        name = f"{n_rovers} rovers from a corner, 30 swaths: speed-up"
        yield Row.of(name, speed_up, "", ">=", 3.4) if n_rovers == 4 else Row(name, speed_up, "")


def _corner(n_rovers: int) -> FloatArray:
    return np.zeros((n_rovers, 2))


DATA = Path(os.environ.get("FIRNLINE_DATA", Path(__file__).parents[2] / "shared" / "data"))
INVENTORIES = (
    ("dem_oggm_glaciers/outlines/rgi_oetztal.shp", "dem_oggm_glaciers/hintereisferner_srtm_90m.tif", 32632),
    ("dem_exploradores_aster/17_rgi60_glacier_outlines.gpkg", "dem_exploradores_aster/AST_L1A_00303182012144228_Z.tif", 32718),
)  # fmt: skip
SINGLE = (
    ("dem_oggm_glaciers/outlines/SouthGlacier.shp", 32607),
    ("dem_avaframe_tirol/polygons/entGar.shp", 31287),
    ("dem_avaframe_tirol/polygons/relGar2.shp", 31287),
)
NUMBERS = (8, 16, 30)
_LEAST_M2, _MOST_OF_ONE = 0.3e6, 10


def real_outlines() -> Iterator[SurveyArea]:
    """Yield twenty outlines, chosen by a rule before anything was measured.

    Of each inventory, the glaciers of 0.3 km² and more that lie within the DEM beside it, at most ten that are evenly
    spread over their order by area; every other one is cut to its lower half, ragged as the cells of the DEM are.
    """
    for outlines, raster, crs in INVENTORIES:
        keys = read_features(DATA / outlines).attributes["RGIId"]
        glaciers = [SurveyArea.read(DATA / outlines, crs=crs, select=(f"RGIId={key}",)) for key in keys]
        tall = [_tongue(glacier, DATA / raster) for glacier in glaciers if glacier.free.area >= _LEAST_M2]
        inside = sorted((pair for pair in tall if pair is not None), key=lambda pair: pair[0].free.area)
        n = min(len(inside), _MOST_OF_ONE)
        for k, index in enumerate(np.linspace(0, len(inside) - 1, n).round().astype(int)):
            yield inside[index][k % 2]
    for outline, crs in SINGLE:
        yield SurveyArea.read(DATA / outline, crs=crs, select=("*",))


def _tongue(glacier: SurveyArea, raster: Path) -> tuple[SurveyArea, SurveyArea] | None:
    """Return a glacier and its lower half; None where the DEM does not cover it."""
    try:
        dem = read_about(raster, glacier.bounds, glacier.crs, "the prior")
    except InputError:
        return None
    heights = dem.elevation.ravel()[glacier.contains(dem.xy)]
    if not shapely.box(*dem.bounds).covers(glacier.polygon) or np.isfinite(heights).mean() < 0.95:
        return None
    return glacier, between_heights(glacier, dem, below_m=float(np.nanmedian(heights)))


def pieces_of_real_outlines(quick: bool) -> Iterator[Row]:
    """Yield pieces, drive and error of swaths on real outlines, beside those of all pieces by the narrowest heading."""
    if not DATA.is_dir():
        sys.exit(f"the folder of real data {DATA} is not here; set FIRNLINE_DATA.")
    areas = list(real_outlines())[:: 4 if quick else 1]
    yield Row("real outlines", len(areas), "")
    folder = Path(tempfile.gettempdir()) / "firnline-real-outlines" / code_digest(("planners",))
    for n in NUMBERS:
        found = np.array(
            [stored(folder / f"{_key(area)}-{n}.json", lambda a=area, n=n: _routed(a, n)) for area in areas]
        )
        ours, every = found[:, 0], found[:, 1]
        what = f"real outlines, {n} swaths"
        yield Row.of(f"{what}: most lines beyond those asked for", (ours[:, 0] - n).max(), "", "<=", 0)
        yield Row(f"{what}: pieces", ours[:, 1].sum(), "")
        yield Row(f"{what}: all pieces", every[:, 1].sum(), "")
        share = 100.0 * ours[:, 2].sum() / ours[:, 1].sum()
        yield Row.of(f"{what}: pieces shorter than 50 m", share, "%", "<=", 5.0)
        yield Row(
            f"{what}: all pieces, shorter than 50 m", 100.0 * every[:, 2].sum() / every[:, 1].sum(), "%"
        )
        for name, column, limit in (("drive", 3, 1.03), ("turns", 4, 1.0), ("predicted RMSE", 5, 1.02)):
            ratio = float((ours[:, column] / every[:, column]).mean())
            yield Row.of(f"{what}: {name} / all pieces, mean", ratio, "x", "<=", limit)


def _key(area: SurveyArea) -> str:
    """Return a name of an outline, by its bounds and its size [m]."""
    return "_".join(f"{value:.0f}" for value in (*area.bounds, area.free.area))


def _routed(area: SurveyArea, n: int) -> list[list[float]]:
    """Return lines, pieces, those shorter than 50 m, drive [m], turns and predicted RMSE [m] of two lawnmowers."""
    every = {"shortest_m": 0.0, "heading_deg": narrowest_heading(area.free)}
    kernel = Matern32(20.0, float(np.sqrt(area.free.area)) / 8.0)
    facts = []
    for settings in ({}, every):
        route = planners.plan(area, None, planners.LawnmowerConfig(swaths=n, **settings))
        lengths = np.array([leg.length_m for leg in route.swaths])
        step_m = max(route.length_m / 1200.0, 5.0)
        error = planners.predict_error(route, area, kernel, noise_m=0.1, sample_step_m=step_m)
        short = float((lengths < 50.0).sum())
        turns = route.prediction["n_turns"]
        facts.append([route.n_lines, len(lengths), short, route.length_m, turns, error.rmse_m])
    return facts


if __name__ == "__main__":
    packages = ("numpy", "scipy", "shapely", "numba")
    if sys.argv[1:2] == ["outlines"]:
        main("Pieces of real outlines", pieces_of_real_outlines, packages, sys.argv[2:])
    else:
        main("Planning", rows, packages)
