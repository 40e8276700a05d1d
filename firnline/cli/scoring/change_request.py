"""Request of ``firnline change``: its options and their checks."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import typer

from firnline.cli.options import DryRun, Json
from firnline.cli.outputs import refuse_existing, with_companions

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
        from survey.reporting.document import OUTPUTS as REPORT_OUTPUTS
        from survey.reporting.document import check_target

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
