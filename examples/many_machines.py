# %% [markdown]
# # Many machines
#
# Monte Carlo studies run in one process, in several processes of a machine, or on a dask cluster. The results have the
# same bytes whatever ran them. This tutorial starts a small cluster on this machine, in the way that a large one is used.
#
# ```shell
# dask scheduler                                          # on one machine
# dask worker tcp://10.0.0.5:8786 --nthreads 1            # on each other machine
# firnline montecarlo study.toml --scheduler tcp://10.0.0.5:8786
# ```
#
# The extra `cluster` installs dask: `pip install firnline[cluster]`.

# %%
import hashlib
from pathlib import Path

from distributed import LocalCluster

from sim.montecarlo.config import read_study
from sim.montecarlo.study import run_study

# %% [markdown]
# ## A study

# %%
STUDY = """
schema_version = 1
name = "many-machines"
seed = 7
trials = 6
swaths = [2, 3]

[[terrains]]
name = "smooth, 120 m"
source = "random"
family = "squared-exponential"
length_scale_m = 120.0
size_m = 240.0

[[planners]]
pattern = "lawnmower"
"""
Path("study.toml").write_text(STUDY, encoding="utf-8")
study = read_study(Path("study.toml"))

# %% [markdown]
# ## The same study twice
#
# First in this process, then on a cluster of two workers that is reached by its address (here both are threads of this
# process). Workers need the same versions
# of firnline and its packages; a study that was begun with other versions is refused.

# %%
run_study(study, Path("here"), engine="serial")

options = {"processes": False, "protocol": "tcp", "dashboard_address": None}
with LocalCluster(n_workers=2, threads_per_worker=1, **options) as cluster:
    print(cluster.scheduler_address.split("://")[0], len(cluster.workers), "workers")
    run_study(study, Path("there"), engine="dask", scheduler=cluster.scheduler_address)

# %%
for name in ("trials.csv", "summary.csv"):
    digests = {
        hashlib.sha256((Path(place) / name).read_bytes()).hexdigest()[:12] for place in ("here", "there")
    }
    print(name, digests, "same bytes" if len(digests) == 1 else "different")

# %% [markdown]
# ## When a machine fails
#
# A trial whose worker died is run again on another one. When everything is stopped, trials that are stored stay: the same
# call continues. All trials are stored here, so this returns at once:

# %%
done = []
run_study(study, Path("here"), engine="serial", watch=lambda n, total: done.append((n, total)))
print(done)
print(sorted(path.name for path in Path("here").iterdir()))

# %% [markdown]
# A folder is used by one run at a time, and a study file that was edited in between is refused; the message names the
# difference. Data types can be pickled, so other work can be divided in the same way: `plan`, `reconstruct` and `score` can be called in any pool.
