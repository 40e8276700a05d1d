"""Interface of a reconstruction method: what it needs, which settings it reads, how it is run."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Literal, NamedTuple, Protocol, Self, TypeVar

from survey.core import Bounds, Progress, ReadOnlyMapping, Section
from survey.data import Dem, Grid, PathError, SurfacePoints, SurveyArea
from survey.reconstruction.capacity import require_nodes
from survey.reconstruction.gp.mean import Mean
from survey.reconstruction.terrain_map import ELEVATION, Reconstruction

if TYPE_CHECKING:
    from survey.reconstruction.joint.drives import PathCorrection
    from survey.reconstruction.joint.solution import JointSolution

SightLines = Literal["truncation", "own", "none"]
"""How a method uses lines of sight: its map is cut off at them afterwards, it uses them itself, or it cannot."""
AnySection = TypeVar("AnySection", bound=Section)


@dataclass(frozen=True)
class MethodSettings:
    """Settings of a method by their class; a class without settings has its defaults.

    `by_class`: one section of each class.
    """

    by_class: Mapping[type[Section], Section] = field(default_factory=lambda: ReadOnlyMapping({}))

    @classmethod
    def of(cls, *sections: Section) -> Self:
        """Return settings of one or several classes."""
        found = {
            kind: section
            for section in sections
            for kind in type(section).__mro__
            if issubclass(kind, Section) and kind is not Section
        }
        return cls(ReadOnlyMapping(found))

    def get(self, kind: type[AnySection]) -> AnySection:
        """Return the settings of a class, or their defaults."""
        found = self.by_class.get(kind)
        return found if isinstance(found, kind) else kind()


@dataclass(frozen=True)
class MappingTask:
    """Input of one map from points.

    `points`: measured points. `grid`: nodes of the map, in the points' CRS. `prior`: expected surface.
    `path`: error that the points share through the poses they were seen from. `quantity`: mapped quantity,
    with its unit. `configs`: settings of the method. `rays`: whether lines of sight bound the map.
    `progress`: progress callback of maps that take long. `area`: ground of which the map claims its error;
    the grid by default. `blunders`: record of the blunders that were left out of the points; by default the
    points are not checked yet.
    """

    points: SurfacePoints
    grid: Grid
    prior: Dem | Mean | None = None
    path: PathError | None = None
    quantity: str = ELEVATION
    configs: MethodSettings = MethodSettings()
    rays: bool = False
    progress: Progress | None = None
    area: SurveyArea | None = None
    blunders: Sequence[Mapping[str, Any]] | None = None

    def config(self, kind: type[AnySection]) -> AnySection:
        """Return the settings of one kind, or their defaults."""
        return self.configs.get(kind)


class MappedTerrain(NamedTuple):
    """A map, the correction of the path where the method estimates one, and the number of points that were mapped.

    `reconstruction`: the map. `correction`: correction of the path. `n_points`: number of points that were
    mapped. `solution`: solution that a joint map was read from, for questions about its covariance.
    """

    reconstruction: Reconstruction
    correction: "PathCorrection | None" = None
    n_points: int = 0
    solution: "JointSolution | None" = None


class ScanModel(Protocol):
    """Terrain model that is updated scan by scan."""

    n_scans_: int

    def update(self, points: SurfacePoints) -> Self:
        """Add one scan."""

    def grid(self, grid: Grid) -> Reconstruction:
        """Return the map on the nodes of a grid."""

    def full_grid(self, step_m: float | None = None) -> Grid:
        """Return a grid over everything that was mapped.

        `step_m`: distance of the nodes [m]; that of the model by default.
        """


class ScanSettings(NamedTuple):
    """Settings of a map from scans: distance of the nodes [m], fixed extent [m], lines of sight, method's settings.

    `step_m`: distance of the nodes [m]. `bounds` (4,): fixed extent ``(xmin, ymin, xmax, ymax)`` [m]. `rays`:
    whether lines of sight bound the map. `configs`: settings of the method.
    """

    step_m: float | None = None
    bounds: Bounds | None = None
    rays: bool = False
    configs: MethodSettings = MethodSettings()


@dataclass(frozen=True)
class ReconstructionMethod:
    """A reconstruction method, as the registry lists it.

    `name`: name in the API, on the command line and in mission files. `summary`: what it is, in a few words.
    `configs`: settings that it reads, by their section in a mission file. `run`: maps points on a grid.
    `begin`: makes the empty model of a map from scans. `sight_lines`: how it uses lines of sight.
    `needs_path`: whether it needs the error that points share through the path. `uses_prior`: whether a prior
    changes the map. `maps_values`: whether it maps other quantities than elevation. `bytes_per_node`: memory
    of a map for every node of its grid [bytes]. `check`: refuses settings that do not fit the extent and the
    step of a map, before any work. `check_cover`: refuses settings whose model would not fit into memory over
    an extent that is covered with points.
    """

    name: str
    summary: str
    run: Callable[[MappingTask], MappedTerrain]
    configs: Mapping[str, type[Section]] = field(default_factory=lambda: ReadOnlyMapping({}))
    begin: Callable[[ScanSettings], ScanModel] | None = None
    sight_lines: SightLines = "truncation"
    needs_path: bool = False
    uses_prior: bool = True
    maps_values: bool = False
    bytes_per_node: float = 120.0
    check: Callable[[ScanSettings], None] | None = None
    check_cover: Callable[[ScanSettings], None] | None = None

    def require_room(
        self,
        bounds: Bounds,
        step_m: float,
        configs: MethodSettings = MethodSettings(),  # frozen
        *,
        covered: bool = False,
    ) -> None:
        """Refuse a map that would not fit into memory, or settings that do not fit the map.

        `bounds` (xmin, ymin, xmax, ymax): extent of the map [m]. `step_m`: distance between the nodes [m].
        """
        require_nodes(bounds, step_m, self.bytes_per_node)
        settings = ScanSettings(step_m, bounds, configs=configs)
        for check in (self.check, self.check_cover if covered else None):
            if check is not None:
                check(settings)
