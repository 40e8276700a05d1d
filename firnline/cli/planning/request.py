"""Request of ``firnline plan``: its options, checked against one another before any work."""

from dataclasses import dataclass, fields
from pathlib import Path
from typing import TYPE_CHECKING, Any

from firnline.cli.planning.options import PlanOptions
from firnline.cli.rasters import own_crs, read_about

if TYPE_CHECKING:
    import survey

_ROUTES = (".geojson", ".gpkg")
_FORMATS = (*_ROUTES, ".pdf", ".qgz")


@dataclass(frozen=True, kw_only=True)
class PlanRequest(PlanOptions):
    """Options of the command, with the files that it reads and writes."""

    @property
    def files(self) -> dict[str, Path]:
        """Files that may be written, by what they hold."""
        if self.out.suffix.lower() in _ROUTES:
            files = {"route": self.out, "picture": self.out.with_suffix(".png")}
            return files if self.season is None else files | self._season_files
        sigma = self.out.with_name(f"{self.out.stem}_sigma.tif")
        if self.out.suffix.lower() == ".qgz":
            area, terrain = (
                self.out.with_name(f"{self.out.stem}_{name}") for name in ("area.gpkg", "terrain.tif")
            )
            route = self.out.with_suffix(".gpkg")
            return {"project": self.out, "route": route, "area": area, "sigma": sigma, "terrain": terrain}
        return {"sheets": self.out, "route": self.out.with_suffix(".geojson"), "sigma": sigma}

    @property
    def _season_files(self) -> dict[str, Path]:
        """Files of a season's design beside the route."""
        return {
            name: self.out.with_name(f"{self.out.stem}_season{suffix}")
            for name, suffix in (("table", ".csv"), ("errors", ".png"))
        }

    @property
    def written(self) -> dict[str, str]:
        """Names of the files that were written, by what they hold."""
        return {name: str(path) for name, path in self.files.items() if path.exists()}

    @property
    def written_text(self) -> str:
        """Names of the files that were written, for a message."""
        return ", ".join(self.written.values())

    @property
    def is_mission(self) -> bool:
        """Whether the source is a mission file."""
        return self.source.suffix == ".toml"

    def given(self, *names: str) -> list[str]:
        """Return those of the named options that were given, as they are written on the command line."""
        known = {field.name for field in fields(self)}
        return [
            "--" + ("set" if name == "settings" else name.replace("_", "-"))
            for name in names
            if name in known and getattr(self, name) not in (None, False, (), [])
        ]

    def check_outputs(self) -> None:
        """Refuse outputs that exist, are inputs, cannot be written or have an unknown format."""
        from firnline.cli.outputs import refuse_existing
        from survey.core.errors import InputError

        if self.out.suffix.lower() not in _FORMATS:
            raise InputError(
                f"the plan {self.out} ends in {self.out.suffix!r}; one of {', '.join(_FORMATS)} was expected "
                "(firnline export writes other formats from it)."
            )
        inputs = (self.source, self.prior, self.no_go, self.driven, self.measured)
        refuse_existing(self.files.values(), force=self.force, inputs=inputs)

    def read_area(self) -> "tuple[survey.SurveyArea, survey.Dem | None]":
        """Read the area, less the ground that a raster marks, and the prior about it, in one CRS."""
        import survey
        from planners.routes.traversability import without_marked
        from survey.io.vector import require_transformation

        crs: Any = self.crs
        if crs is None and self.prior is not None:
            crs = own_crs(self.prior)
        area = survey.SurveyArea.read(self.source, crs=crs)
        if self.out.suffix.lower() == ".pdf":
            require_transformation(area.crs, self.out)
        prior = None if self.prior is None else read_about(self.prior, area.bounds, area.crs, "the prior")
        if self.no_go is not None:
            mask = read_about(self.no_go, area.bounds, area.crs, "the raster of no-go ground", mask=True)
            area = without_marked(area, mask)
        return area, prior
