"""Registry of reconstruction methods, and the settings of a map.

A new method is a module in `methods` and a line in `METHODS`; its settings get a section in `ReconstructionConfig`.
"""

from collections.abc import Iterable
from typing import Annotated, Literal

from pydantic import AfterValidator, PositiveFloat

from survey.core import InputError, Section
from survey.reconstruction.carving.config import SpaceCarvingConfig
from survey.reconstruction.gp.config import GaussianProcessConfig, JointConfig
from survey.reconstruction.lattice.config import FieldLatticeConfig, SpringLatticeConfig
from survey.reconstruction.line_of_sight.config import ScanPointsConfig
from survey.reconstruction.method import MethodSettings, ReconstructionMethod
from survey.reconstruction.methods.gaussian_process import DENSE, GP, JOINT
from survey.reconstruction.methods.scans import CARVING, EMAP, FIELD
from survey.reconstruction.methods.triangulation import TIN

METHODS: dict[str, ReconstructionMethod] = {
    method.name: method for method in (GP, JOINT, DENSE, TIN, FIELD, EMAP, CARVING)
}
"""All reconstruction methods by name."""


def method_named(name: str) -> ReconstructionMethod:
    """Return the method of a name.

    >>> method_named("tin").uses_prior
    False
    """
    if name not in METHODS:
        raise InputError(f"the method {name!r} is not known; take one of {', '.join(METHODS)}.")
    return METHODS[name]


def names_where(methods: Iterable[ReconstructionMethod]) -> str:
    """Return the names of methods as one text for messages.

    >>> names_where(method for method in METHODS.values() if method.begin)
    'field, emap or carving'
    """
    *first, last = (method.name for method in methods)
    return f"{', '.join(first)} or {last}" if first else last


def _known(name: str) -> str:
    if name not in METHODS:
        raise ValueError(f"a reconstruction method ({', '.join(METHODS)}) was expected")
    return name


MethodName = Annotated[str, AfterValidator(_known)]
"""Name of a reconstruction method, checked against the registry."""
LandmarkErrors = Literal["joint", "inflated", "independent"]
"""How the errors that landmarks share through the path are treated."""


class ReconstructionConfig(Section):
    """How the terrain is reconstructed.

    >>> ReconstructionConfig(method="field").rays
    False
    """

    method: MethodName = "gp"
    """Fourier Gaussian process (gp), gp and path as one estimate (joint), dense Gaussian process (dense), Delaunay
    triangulation (tin), Gaussian field (field), spring lattice (emap) or space-carving kernels (carving)."""
    grid_step_m: PositiveFloat = 2.0
    """Distance between the nodes of the map [m]."""
    use_prior: bool = True
    """Use the satellite prior: its cells as measurements in a joint estimate, else as the mean to build around."""
    landmark_errors: LandmarkErrors = "joint"
    """Whether map and path are one estimate (method gp), or landmarks count as independent: with the path's variance
    in each, or (as in the glacier paper) without."""
    rays: bool = False
    """Whether the landmarks' lines of sight bound the map."""
    gp: GaussianProcessConfig = GaussianProcessConfig()
    """Settings of the Gaussian process."""
    joint: JointConfig = JointConfig()
    """Settings of the joint estimate."""
    field: FieldLatticeConfig = FieldLatticeConfig()
    """Settings of the Gaussian field on a lattice."""
    emap: SpringLatticeConfig = SpringLatticeConfig()
    """Settings of the spring lattice."""
    carving: SpaceCarvingConfig = SpaceCarvingConfig()
    """Settings of the space-carving kernels."""
    scans: ScanPointsConfig = ScanPointsConfig()
    """Settings of the points that LiDAR scans become."""

    @property
    def uses_sight_lines(self) -> bool:
        """Whether the map is made or bounded by lines of sight."""
        own = {"field": self.field.rays, "carving": self.carving.carve}
        return self.rays or own.get(self.method, False)

    def configs_of(self, method: ReconstructionMethod) -> MethodSettings:
        """Return the settings that a method reads."""
        sections = dict(self)
        return MethodSettings.of(*(sections[name] for name in method.configs))
