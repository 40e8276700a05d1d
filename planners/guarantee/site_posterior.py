"""Posterior distribution of the covariance of a site's terrain, from its prior and a requirement."""

from planners.guarantee.posterior.kernel_posterior import KernelPosterior, posterior_from_prior
from planners.guarantee.posterior.prior_blocks import PriorBlocks
from planners.guarantee.requirement import MapRequirement
from survey.data.area import SurveyArea
from survey.data.dem import Dem


def posterior_in_grid(area: SurveyArea, prior: Dem, requirement: MapRequirement) -> KernelPosterior:
    """Return the covariances that a prior makes likely, for a requirement whose lengths are grid metres.

    Parameters
    ----------
    area : SurveyArea
        What is to be mapped.
    prior : Dem
        Coarse elevations over the area.
    requirement : MapRequirement
        Errors of the samples and of the prior, and the class of surface.

    Returns
    -------
    KernelPosterior
        With lengths in the metres of the CRS.
    """
    return posterior_from_prior(
        PriorBlocks.of(area, prior),
        noise_m=requirement.noise_m,
        localization_m=requirement.localization_m,
        prior_sigma_m=requirement.prior_sigma_m,
        surface=requirement.surface,
        micro_relief_m=requirement.micro_relief_m,
        assumed=requirement.assumed,
    )
