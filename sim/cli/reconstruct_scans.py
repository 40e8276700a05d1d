"""``firnline reconstruct … --method carving|emap|field``: a map from LiDAR scans, taken in one by one."""

from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from survey.reconstruction.base import Reconstruction
    from survey.reconstruction.carving.space_carving import SpaceCarvingKernel
    from survey.reconstruction.lattice.field_lattice import FieldLattice
    from survey.reconstruction.lattice.spring_lattice import SpringLattice

SCAN_METHODS = ("carving", "emap", "field")
_STEP_M = 0.25
# Kernels are 0.4 m wide at least: more points than this make them slower, not better.
_THIN_M = 0.1


def map_of_scans(
    sources: list[Path],
    method: str,
    step_m: float | None,
    crs: str | None,
    sigma_m: float | None,
    trajectory: Path | None,
    *,
    rays: bool,
    quiet: bool,
) -> "tuple[Reconstruction, str]":
    """Stream scans into a map, and tell how many; with `rays` returns from what overhangs the ground are left out."""
    from sim.cli.progress import counted
    from survey.core.errors import InputError
    from survey.interchange.scans import SensorPath, read_scans, scan_files
    from survey.reconstruction.line_of_sight.ground import ground

    if rays and method == "emap":
        raise InputError(
            "the springs of emap know no lines of sight; take field or carving, or leave --rays out."
        )
    files = scan_files(sources)
    track = None if trajectory is None else SensorPath.read(trajectory)
    model = _model(method, step_m or _STEP_M, rays=rays)
    with counted(quiet=quiet) as progress:
        for n_read, scan in enumerate(read_scans(files, crs=crs, sigma_m=sigma_m, track=track), start=1):
            model.update(scan.select(ground(scan.xyz)) if rays else scan)
            progress("scans", n_read, max(len(files), n_read))
    return _gridded(model, step_m or _STEP_M), f"from {model.n_scans_} scans"


def _model(method: str, step_m: float, *, rays: bool) -> "FieldLattice | SpaceCarvingKernel | SpringLattice":
    """Return the empty map that a method fills."""
    from survey.reconstruction.carving.config import SpaceCarvingConfig
    from survey.reconstruction.carving.space_carving import SpaceCarvingKernel
    from survey.reconstruction.lattice.config import FieldLatticeConfig, SpringLatticeConfig
    from survey.reconstruction.lattice.field_lattice import FieldLattice
    from survey.reconstruction.lattice.spring_lattice import SpringLattice

    if method == "field":
        return FieldLattice(FieldLatticeConfig(step_m=step_m, rays=rays))
    if method == "carving":
        return SpaceCarvingKernel(SpaceCarvingConfig(thin_m=_THIN_M))
    return SpringLattice(SpringLatticeConfig(step_m=step_m, side_m=None))


def _gridded(model: "FieldLattice | SpaceCarvingKernel | SpringLattice", step_m: float) -> "Reconstruction":
    """Return all that was mapped, on its own grid or, for kernels without one, on nodes so far apart."""
    from survey.reconstruction.carving.space_carving import SpaceCarvingKernel

    if isinstance(model, SpaceCarvingKernel):
        return model.grid(model.whole_grid(step_m))
    return model.grid(model.whole_grid())
