"""Configuration of the maps of a Monte Carlo study."""

from typing import Annotated, Any, Literal

from pydantic import (
    Discriminator,
    Field,
    PositiveFloat,
    Tag,
)

from survey.core.config import Section
from survey.reconstruction import GaussianProcessConfig
from survey.reconstruction.gp.config import JointConfig
from survey.reconstruction.gp.families import SearchedFamily
from survey.reconstruction.registry import LandmarkErrors, MethodName, ReconstructionConfig

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
