"""``firnline reconstruct … --method carving|emap|field``: a map from LiDAR scans, taken in one by one."""

from pathlib import Path
from typing import TYPE_CHECKING

import typer

if TYPE_CHECKING:
    from survey.reconstruction.base import Reconstruction

SCAN_METHODS = ("carving", "emap", "field")
_STEP_M = 0.25
# Kernels are 0.4 m wide at least: more points than this make them slower, not better.
_THIN_M = 0.1


def reconstruct_scans(
    sources: list[Path],
    method: str,
    step_m: float | None,
    *,
    crs: str | None,
    sigma_m: float | None,
    trajectory: Path | None,
    out: Path,
    quiet: bool,
    as_json: bool,
    rays: bool = False,
    max_slope_deg: float | None = None,
) -> None:
    """Stream scans into a map and write mean, standard deviation, bounds and support.

    With `rays` lines of sight to the ground bound the map, returns from what overhangs it are left
    out, pictures of mean, width and support are drawn, and ground steeper than `max_slope_deg` for certain is written as ``no_go.tif``.
    """
    from sim.cli.progress import counted
    from survey.errors import InputError
    from survey.io.scans import Track, read_scans, scan_files
    from survey.reconstruction.carving.config import SpaceCarvingConfig
    from survey.reconstruction.carving.space_carving import SpaceCarvingKernel
    from survey.reconstruction.lattice.config import FieldLatticeConfig, SpringLatticeConfig
    from survey.reconstruction.lattice.field_lattice import FieldLattice
    from survey.reconstruction.lattice.spring_lattice import SpringLattice
    from survey.reconstruction.visibility.ground import ground

    if rays and method == "emap":
        raise InputError(
            "the springs of emap know no lines of sight; take field or carving, or leave --rays out."
        )
    files = scan_files(sources)
    track = None if trajectory is None else Track.read(trajectory)
    step = step_m or _STEP_M
    model: FieldLattice | SpaceCarvingKernel | SpringLattice
    if method == "field":
        model = FieldLattice(FieldLatticeConfig(step_m=step, rays=rays))
    elif method == "carving":
        model = SpaceCarvingKernel(SpaceCarvingConfig(thin_m=_THIN_M))
    else:
        model = SpringLattice(SpringLatticeConfig(step_m=step, side_m=None))
    with counted(quiet=quiet) as progress:
        for n_read, scan in enumerate(read_scans(files, crs=crs, sigma_m=sigma_m, track=track), start=1):
            model.update(scan.select(ground(scan.xyz)) if rays else scan)
            progress("scans", n_read, max(len(files), n_read))
    grid = model.whole_grid(step) if isinstance(model, SpaceCarvingKernel) else model.whole_grid()
    result = model.grid(grid)
    out.mkdir(parents=True, exist_ok=True)
    result.write(out)
    if rays:
        draw_and_mark(result, out, max_slope_deg)
    if as_json:
        typer.echo((out / "reconstruction.json").read_text(encoding="utf-8"))
        return
    rows, columns = result.mean.shape
    typer.echo(f"{rows} × {columns} nodes from {model.n_scans_} scans, written to {out / 'dem.tif'}")
    for name, setting in result.hyperparameters.items():
        typer.echo(f"  {name} = {setting:.6g}")


def draw_and_mark(result: "Reconstruction", out: Path, max_slope_deg: float | None) -> None:
    """Write pictures of mean, width and support, and the ground that is too steep for certain."""
    from survey.figures import png_bytes, route_map, support_map
    from survey.figures.bounds import width_map
    from survey.io.files import replacing
    from survey.reconstruction.visibility.steep_ground import steep_ground

    figures = {"mean": route_map(result.mean), "width": width_map(result), "support": support_map(result)}
    for name, figure in figures.items():
        with replacing(out / f"{name}.png") as draft:
            draft.write_bytes(png_bytes(figure))
    if max_slope_deg is not None:
        steep_ground(result, max_slope_deg).write(out / "no_go.tif")
