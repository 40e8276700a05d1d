"""What ``firnline score`` was asked for, and the checks that come before any work."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

import typer

from firnline.cli.options import RunOptions, columns_option, epoch_option

SLOPE = "slope"
"""Value of ``--by`` for classes of slope; anything else is a file."""
_STANDARDS = ["asprs-edition-2"]


@dataclass(frozen=True, kw_only=True)
class ScoreRequest(RunOptions):
    """Options of the command."""

    source: Annotated[
        Path,
        typer.Argument(
            help="Map (raster; its second band is the standard deviation) or mission file (TOML)."
        ),
    ]
    truth: Annotated[
        Path | None, typer.Option("--truth", help="Reference raster, finer and more accurate than the map.")
    ] = None
    checkpoints: Annotated[
        Path | None,
        typer.Option(
            "--checkpoints", help="Independent points (CSV, GeoPackage, GPX …), better than the map."
        ),
    ] = None
    standards: Annotated[
        list[str],
        typer.Option("--standard", help="Judge checkpoints by: asprs-edition-2, asprs-2014, nssda-1998, …"),
    ] = field(default_factory=lambda: list(_STANDARDS))
    class_m: Annotated[
        float | None, typer.Option("--class", help="Class wanted: the RMSE of the newer ASPRS standards [m].")
    ] = None
    horizontal_class_m: Annotated[
        float | None,
        typer.Option(
            "--horizontal-class",
            help="Horizontal class wanted [m]; checkpoints have the columns map_x and map_y.",
        ),
    ] = None
    interval_m: Annotated[
        float | None, typer.Option("--interval", help="Contour interval of ASPRS 1990 and NMAS [m].")
    ] = None
    sigma_m: Annotated[
        float | None, typer.Option("--sigma", help="Deviation of checkpoints that state none [m].")
    ] = None
    columns: Annotated[
        list[str],
        columns_option(
            "Columns of the checkpoint table: x, y, z, lon, lat, sigma_z, name, map_x, map_y, sigma_xy; usual names are found."
        ),
    ] = field(default_factory=list)
    datum: Annotated[
        str | None, typer.Option("--datum", help="Vertical datum of checkpoints that state none.")
    ] = None
    control: Annotated[
        Path | None,
        typer.Option("--control", help="Points that the map was made from; no checkpoint may be one."),
    ] = None
    area: Annotated[Path | None, typer.Option("--area", help="Judge only inside this polygon.")] = None
    route: Annotated[
        Path | None, typer.Option("--route", help="Route that was driven, for coverage, α and β.")
    ] = None
    crs: Annotated[
        str | None,
        typer.Option(
            "--crs", help="CRS of rasters that carry none or a local one (LOCAL_CS), e.g. EPSG:32608."
        ),
    ] = None
    epoch_s: Annotated[
        float | None,
        epoch_option(
            "Move a map of moving ice (folder with ice_motion.json) to this time of its recording first [s]."
        ),
    ] = None
    by: Annotated[
        list[str],
        typer.Option(
            "--by",
            metavar="slope|FILE",
            help="Statistics by class: slope, or a raster or polygons of land cover.",
        ),
    ] = field(default_factory=list)
    class_column: Annotated[
        str | None, typer.Option("--class-column", help="Column of the polygons that names the class.")
    ] = None
    report: Annotated[
        Path | None,
        typer.Option("--report", help="Write an accuracy report: a folder, or a file .html or .pdf."),
    ] = None
    language: Annotated[
        str, typer.Option("--language", help="Language of the statements beside English: en or de.")
    ] = "en"
    force: Annotated[bool, typer.Option("--force", help="Replace a report that is there.")] = False

    @property
    def is_mission(self) -> bool:
        """Whether the source is a mission file."""
        return self.source.suffix == ".toml"

    def check(self) -> None:
        """Refuse what cannot be done, before anything is read."""
        from survey.core.errors import InputError
        from survey.data.ice_motion import ICE_MOTION
        from survey.io.column_names import parse_columns
        from survey.scoring.standards.standards import standard_named

        if self.truth is None and self.checkpoints is None:
            raise InputError(
                f"{self.source} cannot be judged alone; name the reference raster with --truth or points with --checkpoints."
            )
        self._refuse_unused()
        if self.epoch_s is not None and not (self.source / ICE_MOTION).exists():
            raise InputError(
                f"--epoch moves a map with the ice, and {self.source} holds no {ICE_MOTION}; name the folder of a map on moving ice, "
                "or leave --epoch out."
            )
        parse_columns(self.columns)
        for name in self.standards:
            standard_named(name)
        if self.report is not None:
            self._check_report(self.report)

    def _refuse_unused(self) -> None:
        """Refuse a reference beside checkpoints, options of checkpoints without them, and the map as its own reference."""
        from survey.core.errors import InputError

        if self.checkpoints is None:
            options = {
                "--standard": self.standards != _STANDARDS,
                "--class": self.class_m is not None,
                "--horizontal-class": self.horizontal_class_m is not None,
                "--interval": self.interval_m is not None,
                "--sigma": self.sigma_m is not None,
                "--columns": bool(self.columns),
                "--datum": self.datum is not None,
                "--control": self.control is not None,
            }
            unused = next((name for name, is_given in options.items() if is_given), None)
            if unused is not None:
                raise InputError(
                    f"{unused} belongs to --checkpoints, and the map is judged by a raster; leave {unused} out, or name checkpoints."
                )
        elif self.truth is not None:
            raise InputError(
                "--truth and --checkpoints were both given; judge the map by one of them at a time."
            )
        if self.truth is not None and self.truth.absolute() == self.source.absolute():
            raise InputError(
                f"{self.source} is the map and its own reference; name another raster with --truth."
            )

    def _check_report(self, report: Path) -> None:
        from firnline.cli.outputs import refuse_existing
        from survey.reporting.document import OUTPUTS, check_target
        from survey.reporting.statements import template

        template(self.language)
        target = check_target(report)
        inputs = (self.source, self.truth, self.checkpoints, self.control, self.area, self.route)
        refuse_existing([target], force=self.force, inputs=inputs, own=() if target.suffix else OUTPUTS)

    def refuse_options_of_maps(self) -> None:
        """Refuse options that a mission file does not take."""
        from survey.core.errors import InputError

        if self.epoch_s is not None:
            raise InputError(
                f"{self.source} is a mission, whose epoch is a setting of it; add --set ice.epoch_s={self.epoch_s:g} instead of --epoch."
            )
        if self.report is not None or self.by:
            raise InputError(
                f"{self.source} is a mission, whose page firnline report writes; --report and --by judge a map, name its raster or the "
                "folder 4-reconstruct of the run."
            )
