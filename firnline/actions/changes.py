"""Compare two surveys: change of elevation, volume and mass, and the flow of the ice between them."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, NamedTuple

import typer

from firnline.actions.files import refuse_existing, with_companions
from firnline.actions.interface import DryRun, Json
from survey.core.errors import ConfigError, InputError

if TYPE_CHECKING:
    from pyproj import CRS

    from survey import Dem, Reconstruction
    from survey.scoring.change.along_flow import Thickness
    from survey.scoring.motion.displacements import DisplacementField


OUTPUTS = (
    "along_flow.tif",
    "along_flow.tif.aux.xml",
    "change.tif",
    "change.tif.aux.xml",
    "change.csv",
    "change.json",
    "change.png",
)
"""Files that the command writes into its folder."""
# From fresh snow to rock debris.
_DENSITIES_KG_M3 = (50.0, 3000.0)


@dataclass(frozen=True, kw_only=True)
class ChangeRequest:
    """Options of the command."""

    later: Annotated[
        Path,
        typer.Argument(help="Later survey: raster, folder of a reconstruction, or terrain model (.npz)."),
    ]
    earlier: Annotated[Path, typer.Argument(help="Earlier survey, or any elevation raster.")]
    outline: Annotated[
        Path, typer.Option("--outline", help="Polygons over which to compute change (glacier outlines).")
    ]
    stable: Annotated[
        Path | None,
        typer.Option("--stable", help="Ground that did not change; by default all outside the outlines."),
    ] = None
    align: Annotated[
        bool, typer.Option("--align", help="First shift the earlier survey onto the later one.")
    ] = False
    level: Annotated[bool, typer.Option(help="Subtract the mean difference of the unchanged ground.")] = True
    density_kg_m3: Annotated[
        float, typer.Option("--density", help="Density of the gained or lost material [kg/m³].")
    ] = 850.0
    density_std_kg_m3: Annotated[
        float, typer.Option("--density-std", help="Its standard deviation [kg/m³].")
    ] = 60.0
    flow: Annotated[
        str | None,
        typer.Option(
            "--flow",
            help="Flow of the ice between the surveys: track, a file of firnline track, ice_motion.json, or four rasters "
            "EAST,NORTH,SIGMA_EAST,SIGMA_NORTH [m/day]; adds change along the flow and the flux divergence.",
        ),
    ] = None
    days: Annotated[
        float | None,
        typer.Option("--days", min=1e-6, help="Time between the surveys, for velocities [days]."),
    ] = None
    thickness: Annotated[
        str | None,
        typer.Option(
            "--thickness",
            help="With --flow: thickness of the ice [m], or its raster; from the slope within a factor of two when left out.",
        ),
    ] = None
    thickness_error: Annotated[
        float,
        typer.Option(
            "--thickness-error", min=0.0, help="Standard deviation of --thickness over the thickness."
        ),
    ] = 0.2
    crs: Annotated[
        str | None,
        typer.Option("--crs", help="CRS of surveys that carry none or a local one (LOCAL_CS)."),
    ] = None
    step_m: Annotated[
        float, typer.Option("--grid", help="Distance between nodes when terrain models are compared [m].")
    ] = 2.0
    out: Annotated[Path, typer.Option("--out", "-o", help="Folder for change.tif, .csv, .json, .png.")] = (
        Path("change")
    )
    report: Annotated[
        Path | None, typer.Option("--report", help="Write a report: a folder, or a file .html or .pdf.")
    ] = None
    force: Annotated[bool, typer.Option("--force", help="Replace a change that is there.")] = False
    dry_run: DryRun = False
    as_json: Json = False

    @property
    def inputs(self) -> tuple[Path | None, ...]:
        """Every file that is read."""
        return self.later, self.earlier, self.outline, self.stable

    def check(self) -> None:
        """Refuse options without what they belong to, outputs that exist or are inputs, and a report of an unknown form."""
        self._refuse_unused()
        inputs = with_companions(self.inputs)
        refuse_existing([self.out], force=self.force, inputs=inputs, own=OUTPUTS)
        if self.report is None:
            return
        from survey.reporting.document.writing import OUTPUTS as REPORT_OUTPUTS
        from survey.reporting.document.writing import check_target

        own = () if check_target(self.report).suffix else REPORT_OUTPUTS
        refuse_existing([self.report], force=self.force, inputs=inputs, own=own)

    def _refuse_unused(self) -> None:
        """Refuse options of the flow without a flow, and a flow between terrain models."""
        from survey.core.errors import ConfigError, InputError

        stated = [
            name for name, value in {"--days": self.days, "--thickness": self.thickness}.items() if value
        ]
        if not _DENSITIES_KG_M3[0] <= self.density_kg_m3 <= _DENSITIES_KG_M3[1]:
            raise ConfigError(
                f"--density is {self.density_kg_m3:g}; {_DENSITIES_KG_M3[0]:g} to {_DENSITIES_KG_M3[1]:,g} kg/m³ were expected, "
                "such as 850 for ice and firn."
            )
        if self.flow is None and stated:
            raise InputError(f"{stated[0]} belongs to --flow; add --flow, or leave {stated[0]} out.")
        if self.flow is not None and self.later.suffix == ".npz":
            raise InputError("--flow compares maps, and the surveys are terrain models; name their maps.")


class Surveys(NamedTuple):
    """Later and earlier survey, and notes on how they were read."""

    later: "Reconstruction | Dem"
    earlier: "Reconstruction | Dem"
    notes: tuple[str, ...] = ()


def surveys_of(later: Path, earlier: Path, crs: str | None) -> Surveys:
    """Read two surveys; rasters of more cells than a change in memory takes are averaged over squares."""
    from survey.scoring.change.large_surveys import averaged_step_m, averaged_survey

    step_m = averaged_step_m([later, earlier]) if _is_raster(later) and _is_raster(earlier) else None
    if step_m is None:
        return Surveys(_survey(later, crs), _survey(earlier, crs))
    note = f"the surveys were averaged over squares of about {step_m:.3g} m before the comparison."
    return Surveys(averaged_survey(later, step_m, crs), averaged_survey(earlier, step_m, crs), (note,))


def _is_raster(source: Path) -> bool:
    return source.is_file() and source.suffix != ".npz"


def _survey(source: Path, crs: str | None) -> "Reconstruction | Dem":
    """Read a map that is no terrain model."""
    from firnline.actions.scoring import map_of
    from survey.core.errors import InputError

    if source.suffix == ".npz":
        raise InputError(
            f"{source} is a terrain model and the other survey is none; compare two models, or two maps."
        )
    return map_of(source, crs)


TRACKED = "track"
"""Value of the option by which the surveys themselves are tracked."""


def flow_of(named: str, days: float | None, later: "Dem", earlier: "Dem") -> "DisplacementField":
    """Return the displacement between two surveys.

    Raises
    ------
    ConfigError
        Another number of rasters than four.
    InputError
        A velocity without the time between the surveys, or displacements with one.
    """
    from survey.scoring.motion.displacements import TrackedField
    from survey.scoring.motion.tracked_file import read_tracked

    if "," in named:
        return _of_rasters(named, _days(days), later.crs)
    if Path(named).suffix.lower() == ".json":
        return _of_motion(Path(named), _days(days))
    if days is not None:
        raise InputError(
            f"--flow {named} names displacements between the surveys, not velocities; leave --days out."
        )
    if named == TRACKED:
        return _tracked(later, earlier)
    return TrackedField.of(read_tracked(Path(named), later.crs))


def thickness_of(named: str | None, error: float) -> "Thickness | None":
    """Return the thickness that an option names: metres or a raster."""
    from survey import Dem
    from survey.scoring.change.along_flow import Thickness

    if named is None:
        return None
    try:
        value = float(named)
    except ValueError:
        return Thickness(Dem.read(named), error)
    if not 0.0 < value < float("inf"):
        raise ConfigError(f"--thickness is {named} m; give a positive number, or a raster.")
    return Thickness(value, error)


def _tracked(later: "Dem", earlier: "Dem") -> "DisplacementField":
    """Track the features of the earlier survey in the later one, on the grid of the coarser one."""
    from survey import Dem
    from survey.scoring.motion.displacements import TrackedField
    from survey.scoring.motion.tracking import track

    coarser = later if later.step_m >= earlier.step_m else earlier
    grid = coarser.grid()
    early, late = (Dem.on(grid, one.at(grid.xy).reshape(grid.shape)) for one in (earlier, later))
    return TrackedField.of(track(early, late))


def _of_rasters(named: str, days: float, crs: "CRS") -> "DisplacementField":
    from survey import Dem
    from survey.core.crs.agreement import same_crs
    from survey.reconstruction.motion.priors import VelocityRasters
    from survey.scoring.motion.displacements import RasterField

    files = named.split(",")
    if len(files) != 4:
        raise ConfigError(
            f"--flow names {len(files)} rasters; name four with commas: velocity east, velocity north, and their standard "
            "deviations [m/day]."
        )
    rasters = VelocityRasters(*(Dem.read(Path(file)) for file in files))
    for raster in rasters:
        same_crs(crs, raster.crs, "the surveys and the rasters of the velocity")
    return RasterField(rasters, days)


def _of_motion(file: Path, days: float) -> "DisplacementField":
    from survey.data.ice.motion_file import read_motion
    from survey.scoring.motion.displacements import SteadyField

    return SteadyField(read_motion(file), days)


def _days(days: float | None) -> float:
    if days is None:
        raise InputError("--flow names velocities; add --days with the time between the surveys.")
    return days
