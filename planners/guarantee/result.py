"""Result of a guarantee: the route, the probability of its map, and what both rest on."""

from dataclasses import dataclass, field

import numpy as np

from planners.config_lawnmower import LawnmowerConfig
from planners.config_wavy import WavyConfig
from planners.guarantee.posterior.kernel_posterior import KernelPosterior
from planners.guarantee.prediction import MapPrediction
from planners.guarantee.proof.grounds import RESAMPLED
from planners.guarantee.proof.simulation import SimulatedErrors
from planners.guarantee.requirement import MapRequirement
from planners.guarantee.stakes import StakePlan
from survey.data.route import Route

# Ratio of errors from which on they speak against a class; on rough sites without a stated class it was 1.0 to 1.9.
_CONTRADICTED = 2.0

LinePattern = LawnmowerConfig | WavyConfig


@dataclass(frozen=True)
class Guarantee:
    """A route, and the probability that its map meets a requirement.

    Parameters
    ----------
    route : Route
        The shortest route found, or the densest one tried where none meets the requirement.
    config : LawnmowerConfig or WavyConfig
        Its pattern.
    requirement : MapRequirement
        What the map has to meet.
    posterior : KernelPosterior
        Covariances that the guarantee rests on.
    predicted : MapPrediction
        Probability and error from these covariances.
    likely : MapPrediction
        The same where the terrain has the likeliest covariance of the prior.
    likely_swaths : int
        Number of swaths that are enough with that covariance, at most those of the route.
    simulated : SimulatedErrors
        Error of the map in each simulated survey, by kind of ground.
    reachable_m : float
        Error that the densest survey considered stays within with the required probability [m]; it does not
        depend on the limit.
    stakes : StakePlan or None
        Stakes that save swaths, where errors that samples share cost some.
    unstated_m : float or None
        Error that the densest survey reaches where no class of surface is stated [m], for a guarantee that does not hold
        and a class that the relief of the prior contradicts.
    """

    route: Route
    config: LinePattern
    requirement: MapRequirement
    posterior: KernelPosterior
    predicted: MapPrediction
    likely: MapPrediction
    likely_swaths: int
    simulated: SimulatedErrors = field(repr=False)
    reachable_m: float
    stakes: StakePlan | None = None
    unstated_m: float | None = None

    @property
    def simulated_share(self) -> float:
        """Share of the simulated surveys whose map met the limit."""
        return self.simulated.share(self.requirement.limit_m)

    @property
    def simulated_bound(self) -> float:
        """Lower confidence limit of that share, with a confidence of 90 %."""
        return self.simulated.bounds(self.requirement.limit_m)[0]

    @property
    def resampled_ratio(self) -> float:
        """Median error on ground that repeats the relief of the prior at a smaller scale, over the predicted error."""
        return self.simulated.median_m(RESAMPLED) / self.predicted.rmse_m

    @property
    def is_contradicted(self) -> bool:
        """Whether a class of surface is stated and the relief of the prior gives twice its errors, or more."""
        return self.requirement.surface != "unknown" and self.resampled_ratio >= _CONTRADICTED

    @property
    def holds(self) -> bool:
        """Whether the predicted probability is sufficient, and so is the lower confidence limit of the simulated share."""
        limit_m, probability = self.requirement.limit_m, self.requirement.probability
        return self.predicted.probability >= probability and self.simulated.prove(limit_m, probability)

    @property
    def length_m(self) -> float:
        """Distance to drive, on the ground [m]."""
        return self.route.ground_length_m

    @property
    def assumptions(self) -> str:
        """Assumptions on the terrain, in one line."""
        best = self.posterior.likeliest
        families = " or ".join(one.cell.family for one in self.posterior.kernels)
        roughness = np.hypot(self.posterior.spread, self.posterior.open_spread)
        why = "as stated" if self.requirement.assumed else f"surface {self.requirement.surface}"
        return (
            f"covariance {families}, {why}; fitted to the prior: length scale {best.cell.length_scale_m:.0f} m, "
            f"standard deviation {np.sqrt(best.variance_m2):.1f} m, relief finer than samples {np.sqrt(best.unseen_m2):.2f} m; "
            f"the roughness differs from that by a factor of {np.exp(roughness):.2f} (standard deviation); a sample "
            f"errs by {best.noise_m:.2f} m, all together by {self.requirement.shared_m:.2f} m"
        )
