"""Public names and the modules that define them."""

from papers.studies import STUDIES as STUDIES
from papers.studies import study as study
