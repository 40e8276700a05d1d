"""Execution of independent pieces of work: in this process, in local processes, or on a dask cluster.

An engine yields results as they are done, in any order, each with its piece. A piece may be done twice when a
worker dies; the result is the same.
"""

from survey.core.executors.dask_cluster import run_on_dask
from survey.core.executors.processes import FAILED_TO_START, UNGUARDED, settled
from survey.core.executors.run import Engine, open_workers, run_all

__all__ = ["FAILED_TO_START", "UNGUARDED", "Engine", "open_workers", "run_all", "run_on_dask", "settled"]
