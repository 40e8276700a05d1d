"""Request of a change: options that are checked against one another, and the two surveys that they name."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal, NamedTuple

import survey
from firnline.actions.interface import Argument, Option, refuse_existing, with_companions
from firnline.actions.requests import (
    Details,
    Layout,
    Lengths,
    PictureOptions,
    Select,
    columns_option,
    stated_details,
)
from firnline.actions.score_request import map_of, with_datum
from survey.core import ConfigError, picture_files

if TYPE_CHECKING:
    from pyproj import CRS
    from shapely import MultiPolygon, Polygon

    from survey.reconstruction.gp.gp_terrain import GaussianProcessTerrain
    from survey.scoring.differencing.change_files import Glaciers

OUTPUTS = (
    "along_flow.tif", "along_flow.tif.aux.xml", "change.tif", "change.tif.aux.xml", "change.csv",
    "change.gpkg", "change.json", *picture_files("change"), "change_bands.csv", "change_points.csv",
    "change_points.laz", *picture_files("change_points"),
)  # fmt: skip
"""Files that the command writes into its folder."""
_CLOUDS = (".las", ".laz", ".ply")
# From fresh snow to rock debris.
_DENSITIES_KG_M3 = (50.0, 3000.0)


@dataclass(frozen=True, kw_only=True)
class CloudOptions:
    """Options of a comparison of two point clouds."""

    method: Annotated[
        Literal["m3c2"] | None,
        Option(
            "--method",
            help="m3c2 compares two point clouds along the local normal, and states the level of detection of each distance.",
        ),
    ] = None
    registration_m: Annotated[
        float | None,
        Option(
            "--registration",
            min=0.0,
            help="With m3c2: error of the clouds' registration, 1 σ [m]; by default that of the unchanged ground.",
        ),
    ] = None
    normals_m: Annotated[
        list[float],
        Option(
            "--normal-scale",
            min=1e-6,
            help="With m3c2: diameter of the sphere for the normals [m]; repeated, the flattest is taken. By default three from 25 times the "
            "roughness on.",
        ),
    ] = field(default_factory=list)
    cylinder_m: Annotated[
        float | None,
        Option(
            "--cylinder",
            min=1e-6,
            help="With m3c2: diameter of the cylinders [m]; by default that of 30 points.",
        ),
    ] = None
    depth_m: Annotated[
        float | None,
        Option(
            "--depth",
            min=1e-6,
            help="With m3c2: how far the cylinders reach to each side [m]; by default beyond the largest distance.",
        ),
    ] = None
    ground: Annotated[
        Literal["auto", "all", "classified"],
        Option(
            "--ground",
            help="With m3c2: points of LAS/LAZ, as firnline reconstruct takes them; all for cliffs.",
        ),
    ] = "auto"
    columns: Annotated[
        list[str],
        columns_option("With m3c2: columns of tables of points: x, y, z, lon, lat; usual names are found."),
    ] = field(default_factory=list)
    layout: Layout = None

    def refuse_cloud_options(self) -> None:
        """Refuse options of clouds without a method that compares them."""
        usual = CloudOptions()
        names = {
            "--registration": "registration_m", "--normal-scale": "normals_m", "--cylinder": "cylinder_m",
            "--depth": "depth_m", "--ground": "ground", "--columns": "columns", "--format": "layout",
        }  # fmt: skip
        stated = [name for name, key in names.items() if getattr(self, key) != getattr(usual, key)]
        if stated:
            raise survey.InputError(
                f"{stated[0]} is of point clouds; add --method m3c2, or leave {stated[0]} out."
            )


@dataclass(frozen=True, kw_only=True)
class ChangeRequest(PictureOptions, CloudOptions):
    """Two surveys to compare."""

    later: Annotated[
        Path,
        Argument(
            help="Later survey: raster, folder of a reconstruction, terrain model (.npz), or with --method m3c2 a point cloud.",
            reads={".tif": "the raster"},
        ),
    ]
    earlier: Annotated[
        Path,
        Argument(help="Earlier survey, any elevation raster, or point cloud.", reads={".tif": "the raster"}),
    ]
    outline: Annotated[
        Path | None,
        Option(
            "--outline",
            help="Polygons over which to compute change, such as glaciers of an inventory; without, the difference alone.",
            reads="the outline file",
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
        float | None,
        Option(
            "--grid",
            min=1e-6,
            help="Distance between nodes when terrain models are compared (2 by default), or with m3c2 between core points and cells of the map "
            "(by default the diameter of the cylinders) [m].",
        ),
    ] = None
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
        if not _DENSITIES_KG_M3[0] <= self.density_kg_m3 <= _DENSITIES_KG_M3[1]:
            raise ConfigError(
                f"--density is {self.density_kg_m3:g}; {_DENSITIES_KG_M3[0]:g} to {_DENSITIES_KG_M3[1]:,g} kg/m³ were expected, "
                "such as 850 for ice and firn."
            )
        if self.method is None:
            self.refuse_cloud_options()
            self._refuse_unused()
        else:
            self._refuse_options_of_maps()
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

    def _refuse_options_of_maps(self) -> None:
        """Refuse what a comparison of two point clouds does not take."""
        from survey.io.point_files import READ_ENDINGS

        options = {
            "--flow": self.flow,
            "--days": self.days,
            "--thickness": self.thickness,
            "--align": self.align,
            "--report": self.report,
        }
        stated = next((name for name, value in options.items() if value), None)
        if stated is not None:
            raise survey.InputError(
                f"{stated} is of maps, and --method m3c2 compares point clouds; leave {stated} out."
            )
        for file in (self.later, self.earlier):
            if file.suffix.lower() not in READ_ENDINGS:
                raise survey.InputError(
                    f"--method m3c2 compares point clouds ({', '.join(READ_ENDINGS)}), and {file} is none; name clouds, or leave --method out."
                )
        if self.select and self.outline is None:
            raise survey.InputError("--select chooses polygons; add --outline with their file.")

    def _refuse_unused(self) -> None:
        """Refuse options of the flow without a flow, and a flow or no outline between terrain models."""
        cloud = next((one for one in (self.later, self.earlier) if one.suffix.lower() in _CLOUDS), None)
        if cloud is not None:
            raise survey.InputError(
                f"{cloud} is a point cloud; compare two clouds with --method m3c2, or map them first (firnline reconstruct)."
            )
        stated = [
            name for name, value in {"--days": self.days, "--thickness": self.thickness}.items() if value
        ]
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


def polygons_of(request: ChangeRequest, crs: "CRS") -> tuple["Glaciers", "Polygon | MultiPolygon | None"]:
    """Read the outlines, and the ground that did not change; none where they are not named."""
    import shapely

    from survey.scoring.differencing.change_files import Glaciers, read_glaciers, read_outlines

    glaciers = Glaciers({}, {})
    if request.outline is not None:
        glaciers = read_glaciers(request.outline, crs, request.select)
    if request.stable is None:
        return glaciers, None
    return glaciers, shapely.union_all(list(read_outlines(request.stable, crs).values()))


class Clouds(NamedTuple):
    """Later and earlier point cloud, and notes on the points that were left out."""

    later: "survey.SurfacePoints"
    earlier: "survey.SurfacePoints"
    notes: tuple[str, ...]


# Points of clouds need not state their errors, which M3C2 takes from their scatter.
_UNUSED_SIGMA_M = 1.0


def clouds_of(request: ChangeRequest) -> Clouds:
    """Read two point clouds with the ground that the options choose; columns are of the tables among them."""
    from survey.io.column_names import parse_columns
    from survey.io.point_files import TABLES

    files = request.later, request.earlier
    tables = [file for file in files if file.suffix.lower() in TABLES] or files
    columns = parse_columns(request.columns, layout=request.layout)
    (later, new), (earlier, old) = (
        survey.SurfacePoints.read_noted(
            file,
            crs=request.crs,
            sigma_m=_UNUSED_SIGMA_M,
            vertical_datum=request.datum,
            columns=columns if file in tables else None,
            units=request.units,
            ground=request.ground,
        )
        for file in files
    )
    return Clouds(later, earlier, (*new, *old))


def models_of(request: ChangeRequest) -> tuple["GaussianProcessTerrain", "GaussianProcessTerrain", "CRS"]:
    """Read two terrain models, and the CRS that one of them carries."""
    from survey.reconstruction.gp.gp_terrain import GaussianProcessTerrain

    later, earlier = request.later, request.earlier
    new, old = GaussianProcessTerrain.load(later), GaussianProcessTerrain.load(earlier)
    crs = getattr(new.prior, "crs", None) or getattr(old.prior, "crs", None)
    if crs is None:
        raise survey.InputError(
            f"{later} and {earlier} carry no coordinate reference system (models built on a raster do); "
            "compare their maps instead."
        )
    return new, old, crs


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
