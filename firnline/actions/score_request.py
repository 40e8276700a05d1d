"""Request of a score: options that are checked against one another, the map that is judged, and classes of ground."""

import math
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import survey
from firnline.actions.interface import Argument, Option, refuse_existing
from firnline.actions.requests import (
    Details,
    Layout,
    Lengths,
    Pictures,
    RunOptions,
    Select,
    columns_option,
    epoch_option,
    stated_details,
)
from survey.core import InputError

if TYPE_CHECKING:
    from survey.core.arrays import FloatArray
    from survey.scoring.class_scores import ClassScore


SLOPE = "slope"
"""Value of ``--by`` for classes of slope; anything else is a file."""
_STANDARDS = ["asprs-edition-2"]


@dataclass(frozen=True, kw_only=True)
class ScoreRequest(RunOptions):
    """Options of the command."""

    source: Annotated[
        Path,
        Argument(
            help="Map (raster; a second band is the standard deviation unless named otherwise) or mission file (TOML).",
            reads={".toml": "the configuration", ".tif": "the raster"},
        ),
    ]
    truth: Annotated[
        Path | None,
        Option("--truth", help="Reference raster, finer and more accurate than the map.", reads="the raster"),
    ] = None
    checkpoints: Annotated[
        Path | None,
        Option(
            "--checkpoints",
            help="Independent points (CSV, GeoPackage, GPX …), better than the map.",
            reads="the checkpoint file",
        ),
    ] = None
    standards: Annotated[
        list[str],
        Option("--standard", help="Judge checkpoints by: asprs-edition-2, asprs-2014, nssda-1998, …"),
    ] = field(default_factory=lambda: list(_STANDARDS))
    class_m: Annotated[
        float | None, Option("--class", help="Class wanted: the RMSE of the newer ASPRS standards [m].")
    ] = None
    horizontal_class_m: Annotated[
        float | None,
        Option(
            "--horizontal-class",
            help="Horizontal class wanted [m]; checkpoints have the columns map_x and map_y.",
        ),
    ] = None
    interval_m: Annotated[
        float | None, Option("--interval", help="Contour interval of ASPRS 1990 and NMAS [m].")
    ] = None
    sigma_m: Annotated[
        float | None, Option("--sigma", help="Deviation of checkpoints that state none [m].")
    ] = None
    columns: Annotated[
        list[str],
        columns_option(
            "Columns of the checkpoint table: x, y, z, lon, lat, sigma_z, name, map_x, map_y, sigma_xy; usual names are found."
        ),
    ] = field(default_factory=list)
    layout: Layout = None
    units: Lengths = None
    datum: Annotated[
        str | None,
        Option("--datum", help="Vertical datum of map, reference and checkpoints where they state none."),
    ] = None
    control: Annotated[
        Path | None, Option("--control", help="Points that the map was made from; no checkpoint may be one.")
    ] = None
    area: Annotated[
        Path | None, Option("--area", help="Judge only inside this polygon.", reads="the area file")
    ] = None
    select: Select = field(default_factory=list)
    route: Annotated[
        Path | None,
        Option("--route", help="Route that was driven, for coverage, α and β.", reads="the route"),
    ] = None
    crs: Annotated[
        str | None,
        Option("--crs", help="CRS of rasters that carry none or a local one (LOCAL_CS), e.g. EPSG:32608."),
    ] = None
    epoch_s: Annotated[
        float | None,
        epoch_option(
            "Move a map of moving ice (folder with ice_motion.json) to this time of its recording first [s]."
        ),
    ] = None
    by: Annotated[
        list[str],
        Option(
            "--by",
            metavar="slope|FILE",
            help="Statistics by class: slope, or a raster or polygons of land cover.",
        ),
    ] = field(default_factory=list)
    class_column: Annotated[
        str | None, Option("--class-column", help="Column of the polygons that names the class.")
    ] = None
    report: Annotated[
        Path | None, Option("--report", help="Write an accuracy report: a folder, or a file .html or .pdf.")
    ] = None
    language: Annotated[
        str, Option("--language", help="Language of the statements beside English: en, de, es or fr.")
    ] = "en"
    details: Details = field(default_factory=list)
    pictures: Pictures = "png"
    force: Annotated[bool, Option("--force", help="Replace a report that is there.")] = False

    @property
    def is_mission(self) -> bool:
        """Whether the source is a mission file."""
        return self.source.suffix == ".toml"

    @property
    def stated(self) -> dict[str, str]:
        """Project, client, instrument and dates that the report states."""
        return stated_details(self.details)

    def check(self) -> None:
        """Refuse what cannot be done, before anything is read.

        Raises
        ------
        InputError
            Neither reference nor checkpoints, or a report that is there already.
        ConfigError
            An unknown standard, language or form of report, or a column mapping that was not understood.
        """
        from survey.data.ice_motion import ICE_MOTION
        from survey.io.column_names import parse_columns
        from survey.scoring.standards.standards import standard_named

        if self.truth is None and self.checkpoints is None:
            raise InputError(
                f"{self.source} cannot be judged alone; name the reference raster with --truth or points with --checkpoints."
            )
        self._refuse_unused()
        if self.stated and self.report is None:
            raise InputError("--detail is stated in a report; add --report, or leave --detail out.")
        if self.epoch_s is not None and not (self.source / ICE_MOTION).exists():
            raise InputError(
                f"--epoch moves a map with the ice, and {self.source} holds no {ICE_MOTION}; name the folder of a map on moving ice, "
                "or leave --epoch out."
            )
        parse_columns(self.columns, layout=self.layout)
        for name in self.standards:
            standard_named(name)
        if self.report is not None:
            self._check_report(self.report)

    def _refuse_unused(self) -> None:
        """Refuse a reference beside checkpoints, options of checkpoints without them, and the map as its own reference."""
        if self.checkpoints is None:
            options = {
                "--standard": self.standards != _STANDARDS,
                "--class": self.class_m is not None,
                "--horizontal-class": self.horizontal_class_m is not None,
                "--interval": self.interval_m is not None,
                "--sigma": self.sigma_m is not None,
                "--columns": bool(self.columns),
                "--format": self.layout is not None,
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
        from survey.reporting.document import OUTPUTS, check_target
        from survey.reporting.statements import template

        template(self.language)
        target = check_target(report)
        inputs = (self.source, self.truth, self.checkpoints, self.control, self.area, self.route)
        refuse_existing([target], force=self.force, inputs=inputs, own=() if target.suffix else OUTPUTS)

    def refuse_options_of_maps(self) -> None:
        """Refuse options that a mission file does not take.

        Raises
        ------
        InputError
            ``--report`` or ``--by`` was given.
        """
        if self.epoch_s is not None:
            raise InputError(
                f"{self.source} is a mission, whose epoch is a setting of it; add --set ice.epoch_s={self.epoch_s:g} instead of --epoch."
            )
        if self.report is not None or self.by:
            raise InputError(
                f"{self.source} is a mission, whose page firnline report writes; --report and --by judge a map, name its raster or the "
                "folder 4-reconstruct of the run."
            )


def map_of(
    source: Path,
    crs: str | None = None,
    epoch_s: float | None = None,
    units: str | None = None,
    datum: str | None = None,
) -> "survey.Reconstruction | survey.Dem":
    """Read a map, above the vertical datum that was named where it states none; on moving ice, of an epoch."""
    return with_datum(_read_map(source, crs, epoch_s, units), datum, source)


def with_datum(
    read: "survey.Reconstruction | survey.Dem", datum: str | None, source: Path
) -> "survey.Reconstruction | survey.Dem":
    """Return a map above the vertical datum that was named where it states none; refuse another one."""
    if datum is None:
        return read
    from survey.core.crs import same_vertical_datum

    mean = read if isinstance(read, survey.Dem) else read.mean
    same_vertical_datum(mean.vertical_datum, datum, f"{source} and --datum")
    stated = survey.Dem(mean.elevation, mean.transform, mean.crs, mean.vertical_datum or datum)
    return stated if isinstance(read, survey.Dem) else replace(read, mean=stated)


def _read_map(
    source: Path, crs: str | None, epoch_s: float | None, units: str | None
) -> "survey.Reconstruction | survey.Dem":
    """Read firnline's own map from its folder, or anyone's raster with its band of standard deviations (`sigma_band`).

    A map of moving ice is moved to an epoch where one is named.
    """
    import numpy as np

    from survey.data.ice_motion import ICE_MOTION, read_motion
    from survey.io.raster import sigma_band

    if source.is_dir():
        own = survey.Reconstruction.read(source)
        if epoch_s is None:
            return own
        from survey.reconstruction.motion.epoch import at_epoch

        return at_epoch(own, read_motion(source / ICE_MOTION), epoch_s)[0]
    mean = survey.Dem.read(source, crs=crs, units=units)
    if sigma_band(source) is None:
        return mean
    from survey.reconstruction.terrain_map import INTERPOLATED

    std = survey.Dem.read(source, band=2, crs=crs, units=units)
    return survey.Reconstruction(mean, std, np.full(mean.shape, INTERPOLATED), "outside", {})


def today() -> str:
    """Return the date in words, as reports state it."""
    return f"{datetime.now(UTC):%d %B %Y}"


Classes = dict[str, tuple["ClassScore", ...]]


def scores_by_class(
    request: ScoreRequest, errors: "FloatArray", std: "FloatArray", xy: "FloatArray", surface: "survey.Dem"
) -> Classes:
    """Return error statistics by each classification that was asked for.

    `surface` gives the slopes: the reference where there is one, else the map.
    """
    from survey.scoring.class_scores import class_scores, land_cover_at, slope_classes

    found: Classes = {}
    for by in request.by:
        if by == SLOPE:
            names = slope_classes(surface.slope().at(xy))
        else:
            names = land_cover_at(by, xy, surface.crs, request.class_column)
        found[_name_of(by)] = class_scores(errors, std, names)
    return found


def _name_of(by: str) -> str:
    return by if by == SLOPE else Path(by).stem


def class_lines(classes: Classes) -> list[str]:
    """Return the tables of classes as text."""
    lines = []
    for name, rows in classes.items():
        width = max(len(name), *(len(row.name) for row in rows)) + 2
        lines.append(f"{name:<{width}}{'n':>8}{'RMSE':>9}{'NMAD':>9}{'bias':>9}{'in 95 %':>9}")
        lines += [
            f"{row.name:<{width}}{row.n:>8}{row.rmse_m:>9.3f}{row.nmad_m:>9.3f}{row.bias_m:>+9.3f}"
            + (f"{row.coverage_95:>9.1%}" if math.isfinite(row.coverage_95) else f"{'–':>9}")
            for row in rows
        ]
    return lines


def class_values(classes: Classes) -> dict[str, list[dict[str, object]]]:
    """Return the tables of classes as plain values for JSON."""
    from dataclasses import asdict

    return {
        name: [{key: _plain(value) for key, value in asdict(row).items()} for row in rows]
        for name, rows in classes.items()
    }


def _plain(value: object) -> object:
    """Return a value for JSON, None for NaN."""
    return None if isinstance(value, float) and math.isnan(value) else value
