"""Base layer: errors, read-only arrays, configuration, random streams, atomic files, checksums, run folders, CRS.

It does not depend on a survey's data types; code that reads one file format is in `survey.io`. Names that most modules
use are imported from the package; each loads its own module when it is first used.
"""

from survey.core.lazy import attach

__getattr__, __dir__, __all__ = attach(__name__, __file__)
