"""Results of a comparison of two surveys: difference, significance, volumes and masses."""

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from survey.core.arrays import FloatArray
from survey.core.data_object import DataObject
from survey.core.errors import InputError
from survey.core.map_scale import MapScale
from survey.data.dem import Dem
from survey.scoring.change.coregistration import Shift
from survey.scoring.change.variogram import Variogram

SIGNIFICANT = 1.959964
"""A change beyond this many standard deviations is called significant."""
WATER_KG_M3 = 1000.0


class MassBalance(NamedTuple):
    """Change of mass, and its water equivalent per area.

    Parameters
    ----------
    mass_kg, mass_std_kg : float
        Mass gained, negative when lost, and its standard deviation [kg].
    specific_m_we, specific_std_m_we : float
        Specific mass balance and its standard deviation [m water equivalent].
    """

    mass_kg: float
    mass_std_kg: float
    specific_m_we: float
    specific_std_m_we: float


@dataclass(frozen=True)
class VolumeChange:
    """Change of height and volume within one outline.

    Parameters
    ----------
    name : str
        Name of the outline.
    area_m2 : float
        Its area on the ground [m²].
    known_share : float
        Share of it that both surveys map; the rest is assumed to change like the mapped part.
    mean_m : float
        Mean change of height, positive when the surface rose [m].
    volume_m3, std_m3 : float
        Change of volume on the ground and its standard deviation, with the errors' correlation [m³].
    half_width_95_m3 : float
        Half of its 95 % interval [m³].
    naive_std_m3 : float
        Standard deviation if the errors of all cells were independent [m³]; far too small.
    """

    name: str
    area_m2: float
    known_share: float
    mean_m: float
    volume_m3: float
    std_m3: float
    half_width_95_m3: float
    naive_std_m3: float

    def mass(self, density_kg_m3: float = 850.0, density_std_kg_m3: float = 60.0) -> MassBalance:
        """Convert the volume to mass.

        Parameters
        ----------
        density_kg_m3, density_std_kg_m3 : float
            Of what was gained or lost. 850 ± 60 kg m⁻³ is Huss's (2013, The Cryosphere 7, 877–887)
            value for glaciers over five years and more, where the firn did not change and volume did
            visibly; over shorter periods give the density measured.

        Returns
        -------
        MassBalance
            With the errors of volume and density combined, taken to be independent.

        Raises
        ------
        InputError
            A density that is not positive, or a negative deviation.

        Examples
        --------
        >>> lost = VolumeChange("a", 1e6, 1.0, -2.0, -2e6, 1e5, 2e5, 1e3)
        >>> lost.mass().specific_m_we, round(lost.mass().specific_std_m_we, 3)
        (-1.7, 0.147)
        """
        if not (np.isfinite(density_kg_m3) and density_kg_m3 > 0.0 and density_std_kg_m3 >= 0.0):
            raise InputError(
                f"the density is {density_kg_m3} ± {density_std_kg_m3} kg/m³; a positive one was expected."
            )
        mass = density_kg_m3 * self.volume_m3
        std = float(np.hypot(density_kg_m3 * self.std_m3, density_std_kg_m3 * self.volume_m3))
        per_area = WATER_KG_M3 * self.area_m2
        return MassBalance(mass, std, mass / per_area, std / per_area)


class FlowBalance(NamedTuple):
    """Change within one outline with the flow of the ice taken out.

    Parameters
    ----------
    name : str
        Name of the outline.
    along_mean_m, along_std_m : float
        Mean change of height along the flow, of the surface that the outline held at the earlier survey, and its
        standard deviation [m].
    flux_divergence_m, flux_divergence_std_m : float
        Mean thickness of ice that the flow carried out of the outline, and its standard deviation [m].
    balance_m, balance_std_m : float
        Mean gain at surface and bed, change at fixed places plus flux divergence, and its standard deviation [m of ice].
    thickness_m : float
        Mean thickness of the ice [m].
    """

    name: str
    along_mean_m: float
    along_std_m: float
    flux_divergence_m: float
    flux_divergence_std_m: float
    balance_m: float
    balance_std_m: float
    thickness_m: float


@dataclass(frozen=True, eq=False, repr=False)
class AlongFlow(DataObject):
    """Change of a surface that moves, followed along its flow (Lagrangian).

    Parameters
    ----------
    difference : Dem
        Height after the displacement minus height before, at places of the earlier survey [m].
    std_m : (H, W) ndarray
        Standard deviation of each cell's difference, that of the displacement included [m].
    shift_m : (2, H, W) ndarray
        Displacement to the east and to the north [m].
    shift_std_m : (2, H, W) ndarray
        Its standard deviations [m].
    balances : tuple of FlowBalance
        One for each outline.
    """

    difference: Dem
    std_m: FloatArray
    shift_m: FloatArray
    shift_std_m: FloatArray
    balances: tuple[FlowBalance, ...]


@dataclass(frozen=True, eq=False, repr=False)
class Change(DataObject):
    """Change of a surface between two surveys.

    Parameters
    ----------
    difference : Dem
        Later minus earlier [m].
    std_m : (H, W) ndarray
        Standard deviation of each cell's difference [m].
    significant : (H, W) ndarray of int8
        1 where the surface rose significantly at the 95 % level, -1 where it sank, 0 elsewhere. One in
        twenty cells that did not change is called significant too.
    volumes : tuple of VolumeChange
        One for each outline.
    method : str
        ``joint posterior`` of two terrain models, or ``variogram`` of the unchanged ground.
    offset_m : float
        Mean difference of the unchanged ground, which was subtracted [m].
    n_stable : int
        Cells of unchanged ground; 0 for the joint posterior.
    shift : Shift, optional
        Shift of the earlier surface before the comparison.
    variogram : Variogram, optional
        Of the errors of the difference; distances on the ground.
    notes : tuple of str
        Assumptions behind the figures.
    along_flow : AlongFlow, optional
        Change along the flow of the ice, where a flow was given; `difference` is that at fixed places.
    """

    difference: Dem
    std_m: FloatArray
    significant: npt.NDArray[np.int8]
    volumes: tuple[VolumeChange, ...]
    method: str
    offset_m: float = 0.0
    n_stable: int = 0
    shift: Shift | None = None
    variogram: Variogram | None = None
    notes: tuple[str, ...] = ()
    along_flow: AlongFlow | None = None

    @cached_property
    def map_scale(self) -> MapScale:
        """Scale factors of the CRS over the raster, by which areas and volumes were divided."""
        return MapScale.over(self.difference.crs, self.difference.bounds)


def significance(difference: FloatArray, std_m: FloatArray) -> npt.NDArray[np.int8]:
    """Return 1 where the surface rose significantly (H, W), -1 where it sank, 0 elsewhere."""
    beyond = np.abs(difference) > SIGNIFICANT * std_m
    return np.where(beyond, np.sign(np.nan_to_num(difference)), 0.0).astype(np.int8)
