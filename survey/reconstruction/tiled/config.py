"""Settings of maps in tiles."""

from typing import Self

from pydantic import Field, model_validator

from survey.core.config import Section


class TiledConfig(Section):
    """How a large survey is mapped tile by tile.

    Examples
    --------
    >>> TiledConfig().tile_cells
    1000
    """

    cell_m: float = Field(default=1.0, gt=0)
    """Side of a cell of the map [m]."""
    tile_cells: int = Field(default=1000, ge=64, le=4000)
    """Cells along a side of a tile."""
    halo_cells: int = Field(default=96, ge=16, le=512)
    """Cells beyond the edge of a tile whose points count in its solution."""
    coarse_cells: int = Field(default=20, ge=4, le=64)
    """Cells along a side of a block of the long relief."""
    strip_offset_m: float = Field(default=0.2, gt=0)
    """Expected size of the offset of a strip, before the survey's own strips are compared [m]."""
    strip_tilt_m: float = Field(default=0.1, gt=0)
    """Expected size of the error that a strip's tilt makes at its end, before the comparison [m]."""
    withheld_share: float = Field(default=0.01, gt=0, le=0.2)
    """Share of the cells that are withheld from the map to test it."""
    n_draws: int = Field(default=24, ge=8, le=64)
    """Draws from which the standard deviation is taken."""
    ground_class: int = Field(default=2, ge=0, le=255)
    """Class of ground points; files without any such point are used entirely, noise (7 and 18) excepted."""

    @model_validator(mode="after")
    def _blocks_divide_tiles(self) -> Self:
        if self.tile_cells % self.coarse_cells:
            raise ValueError(
                f"tile_cells {self.tile_cells} is no multiple of coarse_cells {self.coarse_cells}; change one of them"
            )
        return self
