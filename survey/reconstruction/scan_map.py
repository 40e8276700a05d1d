"""Map from a stream of LiDAR scans."""

from collections.abc import Callable, Iterable
from dataclasses import replace
from typing import Any, NamedTuple

from survey.core import InputError
from survey.data import Grid, SurfacePoints
from survey.reconstruction.line_of_sight.low_returns import without_low_returns
from survey.reconstruction.mapping import require_heights
from survey.reconstruction.method import ReconstructionMethod, ScanSettings
from survey.reconstruction.observations import without_blunders
from survey.reconstruction.terrain_map import Reconstruction


class ScanMap(NamedTuple):
    """A map, and the number of scans that it was made from."""

    reconstruction: Reconstruction
    n_scans: int


def map_scans(
    scans: Iterable[SurfacePoints],
    method: ReconstructionMethod,
    settings: ScanSettings,
    *,
    grid: Grid | None = None,
    on_scan: Callable[[int], None] = lambda _: None,
) -> ScanMap:
    """Map scans one after the other.

    Gross blunders and isolated returns below the ground are left out of every scan, and with lines of sight also returns
    from what overhangs the ground.
    """
    if method.begin is None:
        raise InputError(f"the method {method.name} maps points, not scans; take field, emap or carving.")
    if settings.rays and method.sight_lines == "none":
        raise InputError(
            f"the method {method.name} uses no lines of sight; take field or carving, or leave the rays out."
        )
    model = method.begin(settings)
    n_scans = n_low_returns = 0
    blunders: list[dict[str, Any]] = []
    for n_scans, scan in enumerate(scans, start=1):
        without_low, n_low = without_low_returns(scan)
        accepted, found = without_blunders(without_low)
        if len(found.rows):
            blunders.append({"scan": n_scans, "sentence": found.sentence(by_row=False), **found.facts()})
        n_low_returns += n_low
        model.update(_ground_of(accepted) if settings.rays else accepted)
        on_scan(n_scans)
    if n_scans == 0:
        raise InputError("there are no scans; at least one is needed.")
    result = model.grid(model.full_grid(settings.step_m) if grid is None else grid)
    diagnostics = {**result.diagnostics, "n_low_returns": n_low_returns}
    if blunders:
        diagnostics["blunders"] = blunders
    return ScanMap(require_heights(replace(result, diagnostics=diagnostics)), n_scans)


def _ground_of(scan: SurfacePoints) -> SurfacePoints:
    from survey.reconstruction.line_of_sight.returns import ground

    return scan.select(ground(scan.xyz))
