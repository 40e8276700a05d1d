"""Request of a change: options that are checked against one another, and the two surveys that they name."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, NamedTuple

import survey
from firnline.actions.interface import Argument, Option, refuse_existing, with_companions
from firnline.actions.requests import Details, Lengths, PictureOptions, Select, stated_details
from firnline.actions.score_request import map_of, with_datum
from survey.core import ConfigError, picture_files

OUTPUTS = (
    "along_flow.tif", "along_flow.tif.aux.xml", "change.tif", "change.tif.aux.xml", "change.csv",
    "change.gpkg", "change.json", *picture_files("change"), "change_bands.csv",
)  # fmt: skip
"""Files that the command writes into its folder."""
# From fresh snow to rock debris.
_DENSITIES_KG_M3 = (50.0, 3000.0)


@dataclass(frozen=True, kw_only=True)
class ChangeRequest(PictureOptions):
    """Two surveys to compare."""

    later: Annotated[
        Path, Argument(help="Later survey: raster, folder of a reconstruction, or terrain model (.npz).")
    ]
    earlier: Annotated[Path, Argument(help="Earlier survey, or any elevation raster.")]
    outline: Annotated[
        Path | None,
        Option(
            "--outline",
            help="Polygons over which to compute change, such as glaciers of an inventory; without, the difference alone.",
        ),
    ] = None
    select: Select = field(default_factory=list)
    stable: Annotated[
        Path | None,
        Option("--stable", help="Ground that did not change; by default all outside the outlines."),
    ] = None
    align: Annotated[
        bool | None,
        Option(
            help="First correct shift, tilt and bias by curvature of the earlier survey; by default, unless both surveys state "
            "the same source."
        ),
    ] = None
    level: Annotated[bool, Option(help="Subtract the median difference of the unchanged ground.")] = True
    density_kg_m3: Annotated[
        float, Option("--density", help="Density of the gained or lost material [kg/m³].")
    ] = 850.0
    density_std_kg_m3: Annotated[float, Option("--density-std", help="Its standard deviation [kg/m³].")] = (
        60.0
    )
    flow: Annotated[
        str | None,
        Option(
            "--flow",
            help="Flow of the ice between the surveys: track, a file of firnline track, ice_motion.json, or four rasters "
            "EAST,NORTH,SIGMA_EAST,SIGMA_NORTH [m/day]; adds change along the flow and the flux divergence.",
        ),
    ] = None
    days: Annotated[
        float | None, Option("--days", min=1e-6, help="Time between the surveys, for velocities [days].")
    ] = None
    thickness: Annotated[
        str | None,
        Option(
            "--thickness",
            help="With --flow: thickness of the ice [m], or its raster; from the slope within a factor of two when left out.",
        ),
    ] = None
    thickness_error: Annotated[
        float,
        Option("--thickness-error", min=0.0, help="Standard deviation of --thickness over the thickness."),
    ] = 0.2
    crs: Annotated[
        str | None, Option("--crs", help="CRS of surveys that carry none or a local one (LOCAL_CS).")
    ] = None
    datum: Annotated[str | None, Option("--datum", help="Vertical datum of surveys that state none.")] = None
    units: Lengths = None
    step_m: Annotated[
        float, Option("--grid", help="Distance between nodes when terrain models are compared [m].")
    ] = 2.0
    out: Annotated[
        Path, Option("--out", "-o", help="Folder for change.tif, .csv, .gpkg, .json and the picture.")
    ] = Path("change")
    report: Annotated[
        Path | None, Option("--report", help="Write a report: a folder, or a file .html or .pdf.")
    ] = None
    details: Details = field(default_factory=list)
    force: Annotated[bool, Option("--force", help="Replace a change that is there.")] = False

    @property
    def inputs(self) -> tuple[Path | None, ...]:
        """Every file that is read."""
        return self.later, self.earlier, self.outline, self.stable

    def check(self) -> None:
        """Refuse options without what they belong to, outputs that exist or are inputs, and a report of an unknown form."""
        self._refuse_unused()
        inputs = with_companions(self.inputs)
        refuse_existing([self.out], force=self.force, inputs=inputs, own=OUTPUTS)
        if stated_details(self.details) and self.report is None:
            raise survey.InputError("--detail is stated in a report; add --report, or leave --detail out.")
        if self.report is None:
            return
        from survey.reporting.document import OUTPUTS as REPORT_OUTPUTS
        from survey.reporting.document import check_target

        own = () if check_target(self.report).suffix else REPORT_OUTPUTS
        refuse_existing([self.report], force=self.force, inputs=inputs, own=own)

    def _refuse_unused(self) -> None:
        """Refuse options of the flow without a flow, and a flow or no outline between terrain models."""
        stated = [
            name for name, value in {"--days": self.days, "--thickness": self.thickness}.items() if value
        ]
        if not _DENSITIES_KG_M3[0] <= self.density_kg_m3 <= _DENSITIES_KG_M3[1]:
            raise ConfigError(
                f"--density is {self.density_kg_m3:g}; {_DENSITIES_KG_M3[0]:g} to {_DENSITIES_KG_M3[1]:,g} kg/m³ were expected, "
                "such as 850 for ice and firn."
            )
        if self.outline is None and (self.select or self.later.suffix == ".npz"):
            what = "--select chooses polygons" if self.select else "terrain models are compared over polygons"
            raise survey.InputError(f"{what}; add --outline with their file.")
        if self.flow is None and stated:
            raise survey.InputError(f"{stated[0]} belongs to --flow; add --flow, or leave {stated[0]} out.")
        if self.flow is not None and self.later.suffix == ".npz":
            raise survey.InputError(
                "--flow compares maps, and the surveys are terrain models; name their maps."
            )


def is_aligned(request: ChangeRequest) -> bool:
    """Return what --align or --no-align says; else whether the surveys do not state the same source."""
    if request.align is not None:
        return request.align
    from survey.io.raster.reading import stated_source

    files = [one / "dem.tif" if one.is_dir() else one for one in (request.later, request.earlier)]
    later, earlier = map(stated_source, files)
    return not later or later != earlier


class Surveys(NamedTuple):
    """Later and earlier survey, and notes on how they were read."""

    later: "survey.Reconstruction | survey.Dem"
    earlier: "survey.Reconstruction | survey.Dem"
    notes: tuple[str, ...] = ()


def surveys_of(request: ChangeRequest) -> Surveys:
    """Read two surveys; rasters of more cells than a change in memory takes are averaged over squares."""
    from survey.scoring.differencing.change_files import average_survey, averaged_step_m

    files = [request.later, request.earlier]
    step_m = averaged_step_m(files) if all(map(_is_raster, files)) else None
    if step_m is None:
        return Surveys(_survey(request.later, request), _survey(request.earlier, request))
    note = f"the surveys were averaged over squares of about {step_m:.3g} m before the comparison."
    new, old = (
        with_datum(average_survey(file, step_m, request.crs, request.units), request.datum, file)
        for file in files
    )
    return Surveys(new, old, (note,))


def _is_raster(source: Path) -> bool:
    return source.is_file() and source.suffix != ".npz"


def _survey(source: Path, request: ChangeRequest) -> "survey.Reconstruction | survey.Dem":
    """Read a map that is no terrain model."""
    if source.suffix == ".npz":
        raise survey.InputError(
            f"{source} is a terrain model and the other survey is none; compare two models, or two maps."
        )
    return map_of(source, request.crs, units=request.units, datum=request.datum)
