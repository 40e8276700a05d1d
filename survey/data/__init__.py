"""Data types of a survey: area, DEM, grid, route, recording, camera, trajectory, surface points.

Types check and hold values; estimation, planning and file formats of other programs live elsewhere. Names that most
modules use are imported from the package; each loads its own module when it is first used.
"""

from survey.core.lazy import attach

__getattr__, __dir__, __all__ = attach(__name__, __file__)
