"""Study files of a Monte Carlo: terrains, planners, maps, and the blocks of trials.

Surveys of one route share the factorization of their maps, so trials come in blocks. A `TrialBlock` is
what one worker does at a time and what is stored; a `Trial` is a row of the table.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal, NamedTuple

from pydantic import Discriminator, Field, NonNegativeFloat, NonNegativeInt, PositiveFloat, PositiveInt, Tag

from planners.registry import PlannerConfig, planner_config
from sim.config.mission import SCHEMA_VERSION, PlacedSection, SensorConfig
from sim.config.rover import RoverConfig
from sim.config.world import SatelliteConfig, TerrainFamily
from survey import ConfigError
from survey.core.config import Section, read_toml, refuse_newer_schema, validated, with_overrides
from survey.reconstruction import GaussianProcessConfig
from survey.reconstruction.gp.config import JointConfig
from survey.reconstruction.gp.families import SearchedFamily
from survey.reconstruction.registry import METHODS, LandmarkErrors, MethodName, ReconstructionConfig
from survey.scoring.standards.map_classes import map_classes
from vision_slam import LocalizationConfig

Name = Annotated[str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9 _.,/()<=-]*$")]
MapClassName = Literal["class-1", "class-2", "class-3"]


class SearchedMap(Section):
    """A Gaussian process whose kernel is searched for each survey; surveys on one route share the work."""

    method: Literal["searched"] = "searched"
    name: Name = "fitted"
    """Name of the map in the table."""
    families: tuple[SearchedFamily, ...] = ("squared-exponential", "matern-5/2", "matern-3/2")
    """Covariance functions to compare by their likelihood."""


class GivenMap(Section):
    """A Gaussian process with the same given kernel for every survey."""

    method: Literal["given"]
    name: Name
    """Name of the map in the table."""
    family: SearchedFamily = "squared-exponential"
    """Covariance function."""
    variance_m2: PositiveFloat
    """Prior variance about the mean [m²]."""
    length_scale_m: PositiveFloat
    """Length scale [m]."""


class ReconstructedMap(Section):
    """Any reconstruction that a mission can have, survey by survey."""

    method: MethodName
    """A reconstruction method, as in a mission."""
    name: Name
    """Name of the map in the table."""
    use_prior: bool = False
    """Build around a satellite's cells instead of a constant."""
    landmark_errors: LandmarkErrors = "joint"
    """Of the statistical fidelity, as in a mission: whether map and path are one estimate (method gp), or landmarks
    count as independent, with the path's variance in each or without."""
    gp: GaussianProcessConfig = GaussianProcessConfig()
    """Settings of the Gaussian process."""
    joint: JointConfig = JointConfig()
    """Settings of the joint estimate."""

    @property
    def settings(self) -> ReconstructionConfig:
        """The same settings as a mission's section has them."""
        return ReconstructionConfig(
            method=self.method,
            use_prior=self.use_prior,
            landmark_errors=self.landmark_errors,
            gp=self.gp,
            joint=self.joint,
        )


def _kind_of_map(given: Any) -> str:
    """Return the tag of a map: searched, given, or else one of the reconstruction methods."""
    method = given.get("method", "searched") if isinstance(given, dict) else given.method
    return method if method in ("searched", "given") else "reconstructed"


Map = Annotated[
    Annotated[SearchedMap, Tag("searched")]
    | Annotated[GivenMap, Tag("given")]
    | Annotated[ReconstructedMap, Tag("reconstructed")],
    Discriminator(_kind_of_map),
]


_SIZES = ("swaths", "spacing_m", "budget_m", "rmse_m")


class RandomKind(Section):
    """Terrain drawn at random for each trial."""

    source: Literal["random"] = "random"
    name: Name
    """Name of the terrain in the table."""
    family: TerrainFamily
    """Kind of random surface."""
    length_scale_m: PositiveFloat = 220.0
    """Correlation length, for the families that have one [m]."""
    size_m: PositiveFloat = 600.0
    """Side of the square site [m]."""
    relief_m: PositiveFloat = 25.0
    """Highest minus lowest point before micro-relief [m]."""
    micro_relief_sd_m: NonNegativeFloat = 0.0
    """Standard deviation of ice micro-relief put on top [m]."""
    step_m: PositiveFloat = 5.0
    """Cell of the fine terrain [m]."""


class ConditionalKind(Section):
    """Terrain drawn at random so that it agrees with a real coarse prior."""

    source: Literal["conditional"]
    name: Name
    """Name of the terrain in the table."""
    file: str
    """The coarse raster; a relative path counts from the study file."""
    sigma_m: NonNegativeFloat = 1.0
    """Standard deviation of the error of its cells [m]."""
    step_m: PositiveFloat = 5.0
    """Cell of the fine terrain [m]."""


TerrainKind = Annotated[RandomKind | ConditionalKind, Field(discriminator="source")]


class SamplesConfig(Section):
    """What the ideal fidelity measures: the terrain's height at equal steps along everything driven."""

    step_m: PositiveFloat = 10.0
    """Travel between samples [m]."""
    noise_m: NonNegativeFloat = 0.0
    """Standard deviation of a sample's height; 0 is a perfect sensor [m]."""
    localization_m: NonNegativeFloat = 0.0
    """Standard deviation of the rover's place, east and north each, independent from sample to sample [m]."""


class Design(NamedTuple):
    """A planner with its parameters, as one point on a curve: its label in the table, and how many swaths."""

    label: str
    swaths: int
    planner: PlannerConfig


class StudyConfig(PlacedSection):
    """Configuration of a study: every terrain is surveyed by every planner at every size, once for each trial."""

    schema_version: Literal[1]
    name: str = Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9_.-]*$")
    """Name of the study and of its folder."""
    seed: NonNegativeInt = 0
    """Everything random follows from it, by name: no trial depends on how many others there are."""
    trials: PositiveInt
    """Number of terrains drawn of each kind."""
    fidelity: Literal["ideal", "statistical"] = "ideal"
    """Depth of the simulation."""
    terrains: tuple[TerrainKind, ...] = Field(min_length=1)
    """Kinds of terrain."""
    planners: tuple[dict[str, Any], ...] = Field(min_length=1)
    """Planners as in a mission file; those without a size are tried at every number of `swaths`."""
    swaths: tuple[PositiveInt, ...] = ()
    """Numbers of swaths to try."""
    maps: tuple[Map, ...] = Field(default=(SearchedMap(),), min_length=1)
    """Reconstructions, all from the same samples."""
    require: MapClassName = "class-3"
    """The map class whose pass share is reported."""
    map_step_m: PositiveFloat = 20.0
    """Distance between the nodes at which maps are judged [m]."""
    samples: SamplesConfig = SamplesConfig()
    rover: RoverConfig = RoverConfig()
    sensors: SensorConfig = SensorConfig()
    """Errors of the statistical fidelity; in both, steered patterns follow attitudes with these errors."""
    localization: LocalizationConfig = LocalizationConfig()
    satellite: SatelliteConfig = SatelliteConfig()

    @property
    def designs(self) -> list[Design]:
        """Every planner at every size, in the order of the file."""
        return [design for index, given in enumerate(self.planners) for design in self._sized(index, given)]

    @property
    def limit_m(self) -> float:
        """Largest RMSE of the wanted class, at its widest contour interval [m]."""
        wanted = self.require.replace("class-", "Class ")
        return next(row.limit_m for row in map_classes() if row.map_class == wanted)

    @property
    def input_files(self) -> dict[str, Path]:
        """The files that the study reads, by the terrain that they are for."""
        return {
            kind.name: self.path(kind.file) for kind in self.terrains if isinstance(kind, ConditionalKind)
        }

    def check(self) -> None:
        """Refuse what no section can see alone."""
        names = {"terrains": [t.name for t in self.terrains], "maps": [m.name for m in self.maps]}
        for what, given in names.items():
            if len(set(given)) < len(given):
                raise ConfigError(f"two of the {what} have the same name; give each its own.")
        labels = [(design.label, design.swaths) for design in self.designs]
        if len(set(labels)) < len(labels):
            raise ConfigError("two planners have the same label and size; give one of them another label.")
        if self.satellite.file is not None:
            raise ConfigError(
                "satellite.file names one raster, and the terrains of a study are drawn; leave it out, or name the errors to "
                "draw by satellite.product."
            )
        if self.sensors.lidar.beams:
            raise ConfigError(
                "a study maps landmarks and has no LiDAR; leave out sensors.lidar, or run missions of its own."
            )
        if self.fidelity == "statistical" and any(not isinstance(m, ReconstructedMap) for m in self.maps):
            raise ConfigError(
                f"landmarks of the statistical fidelity err unequally; give maps of a reconstruction method ({', '.join(METHODS)})."
            )

    def _sized(self, index: int, given: dict[str, Any]) -> list[Design]:
        settings = dict(given)
        label = str(settings.pop("label", settings.get("pattern", "")))
        if any(size in settings for size in _SIZES):
            return [
                Design(label, int(settings.get("swaths") or 0), planner_config(settings, f"planners.{index}"))
            ]
        if not self.swaths:
            raise ConfigError(
                f"planners.{index} has no size; give it swaths, or give the study a list of swaths."
            )
        return [
            Design(label, n, planner_config({**settings, "swaths": n}, f"planners.{index}"))
            for n in self.swaths
        ]


def read_study(path: Path, overrides: Sequence[str] = ()) -> StudyConfig:
    """Read a study file, put ``section.key=value`` overrides in, and check all of it."""
    values = with_overrides(read_toml(path), overrides)
    refuse_newer_schema(values, SCHEMA_VERSION, str(path))
    study = validated(StudyConfig, values, str(path))
    try:
        study.check()
    except ConfigError as error:
        raise ConfigError(f"{path}: {error}") from error
    return study.read_from(path.parent)


_TOGETHER = {"ideal": 50, "statistical": 1}


class TrialBlock(NamedTuple):
    """Trials ``first`` to ``first + n - 1`` on the terrain of this number in the study."""

    terrain: int
    first: int
    n: int

    @property
    def name(self) -> str:
        """Name of the block's file."""
        return f"{self.terrain:03d}-{self.first:07d}"


def trials_together(study: StudyConfig) -> int:
    """Return the number of trials in a block."""
    return _TOGETHER[study.fidelity]


def blocks_of(study: StudyConfig) -> list[TrialBlock]:
    """Return the blocks of a study in the order of its table."""
    size = trials_together(study)
    return [
        TrialBlock(terrain, first, min(size, study.trials - first))
        for terrain in range(len(study.terrains))
        for first in range(0, study.trials, size)
    ]


@dataclass(frozen=True)
class Trial:
    """One line of the table: a survey of one terrain, and how good its map is.

    ``claimed_m`` is the root mean square of the map's own standard deviation; ``silent_share`` the share of
    nodes without a height. Lengths are metres.
    """

    terrain: str
    trial: int
    planner: str
    swaths: int
    map: str
    length_m: float
    n_samples: int
    rmse_m: float
    bias_m: float
    p95_m: float
    worst_m: float
    claimed_m: float
    silent_share: float
    family: str
    length_scale_m: float
    sd_m: float


def as_columns(trials: Sequence[Trial]) -> dict[str, list[Any]]:
    """Return the table's columns."""
    names = Trial.__dataclass_fields__
    return {name: [getattr(trial, name) for trial in trials] for name in names}
