r"""Guarantee of a map class before the survey: a route with a probability, or a refusal.

A prior shows nothing finer than two or three of its cells. The guarantee therefore rests on the class of surface: how
rough measured ground of this class is below that (`planners.guarantee.posterior.surfaces`). The probability that a pattern of so
many swaths meets the limit is predicted; the fewest swaths whose probability is sufficient are then tried on simulated
ground that agrees with the cells and is drawn from another distribution (`planners.guarantee.proof.grounds`). More swaths follow
until the lower confidence limit of the share of these surveys that meet the limit is the probability, too.

The number of swaths never falls with a stricter limit, a higher probability, more noise or a prior of larger standard
deviation: the covariances depend on none of them, and all numbers of swaths are tried from the fewest on.
"""

from dataclasses import replace

from threadpoolctl import threadpool_limits

from planners.ground_metres import settings_factor
from planners.guarantee.posterior.kernel_posterior import KernelPosterior
from planners.guarantee.requirement import MapRequirement
from planners.guarantee.result import Guarantee
from planners.guarantee.site_posterior import posterior_in_grid
from planners.guarantee.swath_search import SwathSearch
from planners.prediction.prior_cover import require_cover
from survey.core.arrays import Progress
from survey.data.area import SurveyArea
from survey.data.dem import Dem


def guarantee(
    area: SurveyArea, prior: Dem, requirement: MapRequirement, *, progress: Progress | None = None
) -> Guarantee:
    """Find the shortest survey whose map meets a requirement, by prediction and by simulation.

    Parameters
    ----------
    area : SurveyArea
        What is to be mapped.
    prior : Dem
        Coarse elevations over the area, in its CRS.
    requirement : MapRequirement
        Largest error of the map, its probability, and the errors of the samples.
    progress : callable, optional
        Called with what is done, how much of it, and of how much.

    Returns
    -------
    Guarantee
        Check whether it `holds`; one that does not names the `reachable_m` error.

    Raises
    ------
    InputError
        A prior in another CRS, without a height on the area, or with too few or too many cells on it; an area
        that no swath meets.
    CapacityError
        More samples or a larger area than can be simulated.

    Notes
    -----
    The map is a Gaussian process fitted to the survey alone. Relief finer than the prior resolves is extrapolated
    with the roughness of the class of surface; an adaptive survey (`planners.guarantee.adaptive`) learns it from the
    first swaths instead. Swaths run across a marked grain of the prior, at most five of its cells apart. Terrain that
    the prior does not cover has the fitted covariance and no known heights. On an area of more than sixteen cells along
    a side the simulated surveys cover a square at its centre.
    """
    require_cover(area, prior)
    grid_requirement = requirement.in_grid_metres(settings_factor(area))
    with threadpool_limits(1):
        search = SwathSearch.of(area, prior, grid_requirement)
        best = search.best(progress)
    return replace(best, requirement=requirement)


def posterior_of(area: SurveyArea, prior: Dem, requirement: MapRequirement) -> KernelPosterior:
    """Return the covariances that the cells of a prior make likely on an area.

    Parameters
    ----------
    area : SurveyArea
        What is to be mapped.
    prior : Dem
        Coarse elevations over the area, in its CRS.
    requirement : MapRequirement
        Its errors of the samples and of the prior are used.

    Returns
    -------
    KernelPosterior
        With lengths in the metres of the CRS.

    Raises
    ------
    InputError
        As `guarantee` does.
    """
    require_cover(area, prior)
    requirement = requirement.in_grid_metres(settings_factor(area))
    return posterior_in_grid(area, prior, requirement)
