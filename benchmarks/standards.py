"""Standards, checkpoints, change and formats, measured: ``python -m benchmarks.standards``."""

import os
import subprocess
import sys
import tempfile
from collections import Counter
from collections.abc import Iterator, Sequence
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import rasterio
from affine import Affine
from rasterio.windows import Window

from benchmarks.accuracy_examples import Example, examples, paper_tables, stored_examples
from benchmarks.change_worlds import Judged, World, landlab_pair, model_pair, raster_pair
from benchmarks.format_samples import SAMPLES, flipped, put, truncated
from benchmarks.report import Row, main
from survey.core.errors import FirnlineError

DATA = Path(os.environ.get("FIRNLINE_DATA", Path(__file__).parents[2] / "shared" / "data"))
# Seeds that nothing was chosen by.
_FIRST_SEED = 88_000


def measure(quick: bool) -> Iterator[Row]:
    yield _reproduced("worked examples to all printed digits", list(examples()))
    yield _reproduced("glacier paper, Tables I to III", list(paper_tables()))
    if DATA.is_dir():
        yield _reproduced("stored examples and another tool's statistics", list(stored_examples(DATA)))
        yield from _landlab()
        yield from _judge()
    yield from _volume(quick)
    yield from _damage(quick)
    yield from _large(quick)


def _reproduced(name: str, found: Sequence[Example]) -> Row:
    missed = [example.name for example in found if not example.holds]
    for miss in missed:
        print(f"  missed: {miss}", file=sys.stderr)
    return Row.of(f"{name} ({len(found)})", 100.0 * (1.0 - len(missed) / len(found)), "%", ">=", 100.0)


def _landlab() -> Iterator[Row]:
    found = landlab_pair(DATA)
    yield Row.of("real landslide, worst cell of the recovered difference", found.worst_m, "m", "<=", 1e-4)
    yield Row.of("real landslide, volume off by", found.volume_off, "1", "<=", 1e-6)
    off = found.noisy_off_in_half_widths
    yield Row.of("the same from surveys with 0.3 m of noise, in half 95 % intervals", off, "1", "<=", 1.0)


def _judge() -> Iterator[Row]:
    """Hold statistics and co-registration against xdem's on the same pair."""
    if find_spec("xdem") is None:
        return
    from benchmarks.xdem_judge import agreement

    statistics, shift_m, true_m = agreement(DATA)
    yield Row.of("statistics apart from xdem's, relative", statistics, "1", "<=", 1e-5)
    yield Row.of("co-registration apart from xdem's", shift_m, "m", "<=", 0.05)
    yield Row.of("co-registration apart from the true shift", true_m, "m", "<=", 0.05)


def _volume(quick: bool) -> Iterator[Row]:
    n = 100 if quick else 200
    seeds = range(_FIRST_SEED, _FIRST_SEED + n)
    yield from _interval("rasters, variogram", [raster_pair(seed, World()) for seed in seeds])
    yield from _interval("terrain models, joint posterior", [model_pair(seed) for seed in seeds])
    if quick:
        return
    hard = World(long=(0.6, 150.0), radius_m=300.0)
    found = [raster_pair(seed, hard) for seed in seeds]
    yield _share("rasters, errors that go together over a third of the site", found)
    found = [model_pair(seed, shared=0.9) for seed in seeds]
    yield _share("terrain models, nine tenths of the relief unchanged", found)


def _interval(name: str, found: Sequence[Judged]) -> Iterator[Row]:
    share = 100.0 * float(np.mean([pair.holds for pair in found]))
    yield Row(
        f"{name}: 95 % interval holds ({len(found)} pairs)", share, "%", "92 to 98", 92.0 <= share <= 98.0
    )
    errors = np.array([pair.error_m3 for pair in found])
    yield Row(
        f"{name}: error over stated deviation",
        float(np.sqrt(np.mean((errors / [p.std_m3 for p in found]) ** 2))),
        "1",
    )
    naive = 100.0 * float(np.mean([pair.naive_holds for pair in found]))
    yield Row(f"{name}: naive 95 % interval holds", naive, "%")
    ratio = float(np.median([pair.std_m3 / pair.naive_std_m3 for pair in found]))
    yield Row(f"{name}: stated over naive deviation", ratio, "1")


def _share(name: str, found: Sequence[Judged]) -> Row:
    return Row(f"{name}: 95 % interval holds", 100.0 * float(np.mean([pair.holds for pair in found])), "%")


def _damage(quick: bool) -> Iterator[Row]:
    """Read every format damaged; a value that differs although the file is stated to be intact counts as altered."""
    counts: Counter[tuple[str, str]] = Counter()
    n = 20 if quick else 100
    with tempfile.TemporaryDirectory() as place:
        for name, sample in SAMPLES.items():
            path = Path(place) / name
            sample.write(path)
            whole, good = path.read_bytes(), sample.read(path)
            for damage, files in (("cut off", truncated(whole)), ("one bit flipped", flipped(whole, n))):
                for content in files:
                    put(path, content)
                    counts[damage, _outcome(name, path, good)] += 1
    for damage in ("cut off", "one bit flipped"):
        total = sum(count for (kind, _), count in counts.items() if kind == damage)
        other = counts[damage, "other exception"]
        yield Row.of(
            f"{damage} ({total} files, {len(SAMPLES)} formats): other exceptions", other, "", "<=", 0
        )
        yield Row(f"{damage}: refused", 100.0 * counts[damage, "refused"] / total, "%")
        altered = 100.0 * counts[damage, "altered"] / total
        bar = Row.of(f"{damage}: answer altered", altered, "%", "<=", 0.0)
        yield bar


def _outcome(name: str, path: Path, good: tuple[bytes, ...]) -> str:
    try:
        return "right" if SAMPLES[name].read(path) == good else "altered"
    except FirnlineError as refusal:
        return "refused" if "\n" not in str(refusal) else "other exception"
    except Exception:
        return "other exception"


_SCORE = """
import resource, sys, time
from survey.scoring.scores import score_files
start = time.process_time()
found = score_files(*sys.argv[1:])
print(time.process_time() - start, resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024 / 1e9, found.elevation.rmse_m, found.elevation.nmad_m)
"""


def _large(quick: bool) -> Iterator[Row]:
    """Score large rasters in a process of their own."""
    side = 4_000 if quick else 10_000
    with tempfile.TemporaryDirectory() as place:
        files = [Path(place) / name for name in ("map.tif", "reference.tif")]
        for file, sigma in zip(files, (0.3, 0.0), strict=True):
            _write_large(file, side, sigma)
        command = [sys.executable, "-c", _SCORE, *map(str, files)]
        said = subprocess.run(command, check=True, capture_output=True, text=True).stdout
    seconds, gigabytes, rmse, nmad = map(float, said.split())
    cells = f"{side**2 / 1e6:.0f} million cells"
    yield Row.of(f"scoring {cells}: memory", gigabytes, "GB", "<=", 1.0)
    yield Row(f"scoring {cells}: time", seconds, "s")
    # sqrt(0.1^2 + 0.3^2), known to 1 / sqrt(2 n).
    yield Row.of(f"scoring {cells}: RMSE off by", abs(rmse - np.hypot(0.1, 0.3)), "m", "<=", 3e-4)
    yield Row.of(f"scoring {cells}: NMAD off by", abs(nmad - 0.3), "m", "<=", 5e-4)


def _write_large(file: Path, side: int, sigma: float) -> None:
    rng = np.random.default_rng(5)
    profile = {
        "driver": "GTiff",
        "height": side,
        "width": side,
        "count": 1,
        "dtype": "float32",
        "nodata": -9999.0,
    }
    tiles = {"tiled": True, "blockxsize": 512, "blockysize": 512}
    place = Affine(1.0, 0.0, 0.0, 0.0, -1.0, float(side))
    with rasterio.open(file, "w", crs="EPSG:32608", transform=place, **profile, **tiles) as target:
        for first in range(0, side, 512):
            rows = min(512, side - first)
            heights = (
                100.0
                + 20.0
                * np.sin(np.arange(side) / 300.0)
                * np.cos(np.arange(first, first + rows) / 200.0)[:, None]
            )
            if sigma:
                heights += 0.1 + sigma * rng.standard_normal((rows, side), dtype=np.float32)
            target.write(heights.astype(np.float32), 1, window=Window(0, first, side, rows))


if __name__ == "__main__":
    main("standards", measure, ("numpy", "scipy", "rasterio", "pyogrio", "laspy", "xarray", "xdem"))
