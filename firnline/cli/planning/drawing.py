"""What is drawn of a plan beside its route: area, terrain, predicted error, what is left out, assumptions."""

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import planners
    import survey
    from planners.routes.traversability import LeftOut
    from survey.reconstruction.gp.kernels import Kernel

_NODES_ALONG = 60


@dataclass(frozen=True)
class PlanDrawing:
    """What is drawn of a plan beside its route; `kernel` is the covariance of the predicted error, if any."""

    area: "survey.SurveyArea"
    terrain: "survey.Dem | None" = None
    kernel: "Kernel | None" = None
    noise_m: float = 0.0
    rover: "planners.Rover | None" = None
    left_out: "tuple[LeftOut, ...]" = ()
    assumptions: tuple[str, ...] = field(default_factory=tuple)

    @property
    def fine_cell_m(self) -> float:
        """Cell in which the standard deviation is written [m]."""
        xmin, ymin, xmax, ymax = self.area.bounds
        return max(xmax - xmin, ymax - ymin) / _NODES_ALONG

    def std(self, route: "survey.Route", cell_m: float | None = None) -> "survey.Dem | None":
        """Return the predicted standard deviation of the map; None where no covariance is known."""
        import planners

        if self.kernel is None:
            return None
        return planners.predict_error(route, self.area, self.kernel, noise_m=self.noise_m, cell_m=cell_m).std
