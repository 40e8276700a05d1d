"""Ground that a rover can drive on, and the ground that it leaves out."""

from dataclasses import dataclass
from typing import Literal

from shapely import Polygon

from planners.ground.transit import FreeGround
from survey.data.area import SurveyArea

Reason = Literal["too steep", "too rough", "height unknown", "too narrow", "cut off"]


@dataclass(frozen=True)
class LeftOut:
    """Piece of the area where the rover cannot be, and why.

    Parameters
    ----------
    polygon : shapely.Polygon
        Outline in the area's CRS [m].
    reason : {"too steep", "too rough", "height unknown", "too narrow", "cut off"}
        Why it is left out.
    map_scale : float
        Grid metres for each metre on the ground, where this differs from 1 by more than 1 %.
    """

    polygon: Polygon
    reason: Reason
    map_scale: float = 1.0

    @property
    def area_m2(self) -> float:
        """Area on the ground [m²]."""
        return float(self.polygon.area) / self.map_scale**2

    def __str__(self) -> str:
        """Return area, place and reason in half a sentence."""
        x, y = self.polygon.representative_point().coords[0]
        return f"{self.area_m2:.0f} m² around ({x:.1f}, {y:.1f}) ({self.reason})"


@dataclass(frozen=True)
class Drivable:
    """Ground that can be surveyed, and the pieces of the area that cannot.

    Parameters
    ----------
    ground : FreeGround
        Where rovers may be.
    left_out : tuple of LeftOut
        The rest of the area, by reason.
    """

    ground: FreeGround
    left_out: tuple[LeftOut, ...]

    def within(self, area: SurveyArea) -> SurveyArea:
        """Return the area cut to the ground.

        Parameters
        ----------
        area : SurveyArea
            The area that the ground was found in.

        Returns
        -------
        SurveyArea
            Starts on the border move a millimetre inwards.
        """
        if self.ground.polygon.equals(area.free):
            return area
        starts = self.ground.inside(area.starts) if len(area.starts) else area.starts
        return SurveyArea(self.ground.polygon, area.crs, (), starts, area.reference)

    def left_out_share(self, area: SurveyArea) -> float:
        """Return the share of the area's free ground that is left out.

        Parameters
        ----------
        area : SurveyArea
            The area that the ground was found in.

        Returns
        -------
        float
            Between 0 and 1.
        """
        return float(sum(piece.polygon.area for piece in self.left_out)) / float(area.free.area)

    def __str__(self) -> str:
        """List the three largest pieces that are left out, with place and reason."""
        return listed(list(self.left_out))


def listed(pieces: list[LeftOut]) -> str:
    """Return a list of the three largest pieces, and how many more there are."""
    largest = sorted(pieces, key=lambda piece: -piece.polygon.area)
    rest = f" and {len(pieces) - 3} more" if len(pieces) > 3 else ""
    return ", ".join(str(piece) for piece in largest[:3]) + rest
