"""Results of a Monte Carlo study: tables of trials, statistics, and the report page.

Trials are stored as Parquet, one file for each block and one for the study, with checksums of their values. The summary
gives mean error, spread and pass share of every curve and size. The page shows error against swaths and distance, with
the limits of the classes.
"""

import csv
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import fields
from functools import reduce
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.csv as pa_csv
import pyarrow.parquet as pq
import tomlkit
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import NullFormatter, StrMethodFormatter

from sim.montecarlo.config import StudyConfig, Trial, TrialBlock, as_columns
from survey.core import FloatArray, InputError, existing_file, first_line, replacing, stream
from survey.core.text import csv_cell
from survey.figures.style import FULL_IN, INK, MUTED, ROVERS, styled
from survey.io.arrays_file import checksum
from survey.reporting.quantities import number, percent
from survey.reporting.rendering import PNG, Picture, PictureForm, picture_of, render
from survey.scoring.standards.map_classes import map_classes

_CRC = b"firnline_crc32"
_TYPES = {str: pa.string(), int: pa.int32(), float: pa.float64()}
SCHEMA = pa.schema([(field.name, _TYPES[field.type]) for field in fields(Trial)])  # type: ignore[index]


def block_file(folder: Path, block: TrialBlock) -> Path:
    """Return the file of a block in a study's folder."""
    return folder / "blocks" / f"{block.name}.parquet"


def write_block(folder: Path, block: TrialBlock, trials: Sequence[Trial]) -> None:
    """Write the trials of a block with the checksum of their values."""
    with replacing(block_file(folder, block)) as draft:
        _write(draft, [pa.table(as_columns(trials), schema=SCHEMA)])


def write_tables(draft: Path, folder: Path, blocks: Sequence[TrialBlock]) -> None:
    """Join the blocks of a study's folder, in its order, into ``trials.parquet`` and ``trials.csv`` of a draft folder.

    One block is in memory at a time.
    """
    _write(draft / "trials.parquet", _tables(folder, blocks))
    with pa_csv.CSVWriter(draft / "trials.csv", SCHEMA) as text:
        for table in _tables(folder, blocks):
            text.write_table(_with_escaped_names(table))


def read_trials(path: Path) -> pa.Table:
    """Read a table of trials and check the checksum of its values."""
    file = existing_file(path, "the table of trials")
    try:
        with pq.ParquetFile(file) as stored:
            stated = (stored.metadata.metadata or {})[_CRC].decode("ascii")
            groups = [stored.read_row_group(n).cast(SCHEMA) for n in range(stored.num_row_groups)]
        crc = reduce(_crc, groups, "0")
    except Exception as error:  # a damaged file fails in thrift, the codec, UTF-8, the cast, …
        raise _damaged(file, first_line(error)) from error
    if crc != stated:
        raise _damaged(file, f"its values have the checksum {crc}, and it states {stated[:16]!r}")
    return pa.concat_tables(groups) if groups else SCHEMA.empty_table()


def _write(path: Path, tables: Sequence[pa.Table] | Iterator[pa.Table]) -> None:
    """Write tables as row groups of one file, and the checksum of all into its footer."""
    crc = "0"
    with pq.ParquetWriter(path, SCHEMA) as parquet:
        for table in tables:
            parquet.write_table(table, row_group_size=max(len(table), 1))
            crc = _crc(crc, table)
        parquet.add_key_value_metadata({_CRC.decode("ascii"): crc})


def _tables(folder: Path, blocks: Sequence[TrialBlock]) -> Iterator[pa.Table]:
    for block in blocks:
        yield read_trials(block_file(folder, block))


def _with_escaped_names(table: pa.Table) -> pa.Table:
    """Escape the columns of names for a CSV table."""
    for place, field in enumerate(SCHEMA):
        if pa.types.is_string(field.type):
            names = [csv_cell(name) for name in table.column(place).to_pylist()]
            table = table.set_column(place, field, pa.array(names, field.type))
    return table


def _crc(before: str, table: pa.Table) -> str:
    """Return the checksum of a table's values that follow those with the checksum `before`."""
    parts: list[object] = [before]
    for field, column in zip(SCHEMA, table.columns, strict=True):
        is_text = pa.types.is_string(field.type)
        parts += [field.name, "\x1f".join(column.to_pylist()) if is_text else np.asarray(column)]
    return checksum(parts)


def _damaged(file: Path, reason: str) -> InputError:
    return InputError(f"the table {file} is damaged ({reason}); delete it and run the study again.")


_N_RESAMPLES = 1000
_WANTED_SHARE = 0.9
SummaryRow = dict[str, Any]


def summarize_trials(table: Path, study: StudyConfig) -> list[SummaryRow]:
    """Return one row for every terrain, planner, number of swaths and map, in the order of the study.

    Intervals hold 95 % of the values that resampled trials give (percentile bootstrap, Efron 1979).
    """
    columns = ["planner", "swaths", "map", "rmse_m", "length_m", "claimed_m", "silent_share"]
    rows = []
    everything = read_trials(table).select(["terrain", *columns])
    for kind in study.terrains:
        trials = everything.filter(pc.field("terrain") == kind.name)
        for design in study.designs:
            for how in study.maps:
                mine = trials.filter(
                    (pc.field("planner") == design.label)
                    & (pc.field("swaths") == design.swaths)
                    & (pc.field("map") == how.name)
                )
                values = {name: mine[name].to_numpy() for name in columns[3:]}
                head = {
                    "terrain": kind.name,
                    "planner": design.label,
                    "swaths": design.swaths,
                    "map": how.name,
                }
                rows.append({**head, **statistics(values, study.limit_m, tuple(map(str, head.values())))})
    return rows


def statistics(values: Mapping[str, FloatArray], limit_m: float, names: Sequence[str]) -> SummaryRow:
    """Return the statistics of one set of trials; `names` name the stream of its bootstrap."""
    rmse = values["rmse_m"]
    rng = stream(0, "bootstrap", *names)
    measures: dict[str, Callable[[FloatArray], FloatArray]] = {
        "mean_rmse_m": lambda x: x.mean(axis=-1),
        "p95_rmse_m": lambda x: np.percentile(x, 95.0, axis=-1),
        "pass_share": lambda x: (x <= limit_m).mean(axis=-1),
    }
    resampled: dict[str, list[FloatArray]] = {name: [] for name in measures}
    for _ in range(_N_RESAMPLES // 50):
        picked = rmse[rng.integers(len(rmse), size=(50, len(rmse)))]
        for name, measure in measures.items():
            resampled[name].append(measure(picked))
    row: SummaryRow = {"n": len(rmse), "mean_length_m": float(values["length_m"].mean())}
    for name, measure in measures.items():
        low, high = np.percentile(np.concatenate(resampled[name]), [2.5, 97.5])
        row |= {name: float(measure(rmse)), f"{name}_low": float(low), f"{name}_high": float(high)}
    row["median_rmse_m"] = float(np.median(rmse))
    row["pooled_rmse_m"] = float(np.sqrt(np.mean(rmse**2)))
    row["mean_claimed_m"] = float(values["claimed_m"].mean())
    row["silent_share"] = float(values["silent_share"].mean())
    return row


def minimum_swaths(rows: Sequence[SummaryRow], study: StudyConfig) -> list[SummaryRow]:
    """Return, for each curve, the fewest swaths whose mean error meets the class, and those whose trials do in 90 %.

    Empty where no number of swaths tried does.
    """
    result = []
    for curve, points in curves(rows).items():
        by_mean = [p["swaths"] for p in points if p["mean_rmse_m"] <= study.limit_m]
        by_share = [p["swaths"] for p in points if p["pass_share"] >= _WANTED_SHARE]
        result.append(
            {
                "terrain": curve[0],
                "planner": curve[1],
                "map": curve[2],
                "limit_m": study.limit_m,
                "fewest_by_mean": min(by_mean, default=None),
                "fewest_by_90_percent": min(by_share, default=None),
            }
        )
    return result


def curves(rows: Sequence[SummaryRow]) -> dict[tuple[str, str, str], list[SummaryRow]]:
    """Return the points of each curve, (terrain, planner, map), by rising number of swaths."""
    found: dict[tuple[str, str, str], list[SummaryRow]] = {}
    for row in rows:
        found.setdefault((row["terrain"], row["planner"], row["map"]), []).append(row)
    return {key: sorted(points, key=lambda point: point["swaths"]) for key, points in found.items()}


def write_rows(path: Path, rows: Sequence[SummaryRow]) -> None:
    """Write rows as CSV; numbers read back as they were, names are escaped, nothing stands for None."""
    with replacing(path) as draft, draft.open("w", encoding="utf-8", newline="") as file:
        writer = csv.DictWriter(file, list(rows[0]), lineterminator="\n")
        writer.writeheader()
        writer.writerows(
            {key: csv_cell(value) if isinstance(value, str) else value for key, value in row.items()}
            for row in rows
        )


_MARKERS = "os^vD"
_DASHES = ("-", (0, (4, 1.5)), ":", (0, (6, 1, 1, 1)))


def write_study_report(
    folder: Path, study: StudyConfig, rows: Sequence[SummaryRow], form: PictureForm = PNG
) -> Path:
    """Write ``index.html`` and its figures, in ``figures``, into the study's folder; return the page."""
    (folder / "figures").mkdir(exist_ok=True)
    pictures, names = {}, {}
    for index, kind in enumerate(study.terrains):
        mine = [row for row in rows if row["terrain"] == kind.name]
        names[kind.name] = f"figures/{index:02d}-error.{form.kind}"
        picture = picture_of(
            error_curves({kind.name: mine}, study.limit_m),
            f"Mean error of the map against swaths and distance on {kind.name}",
            "Mean over the trials with its 95 % bootstrap interval; the limits of the map classes are drawn.",
            form,
        )
        with replacing(folder / names[kind.name]) as draft:
            draft.write_bytes(picture.image)
        pictures[kind.name] = picture
    page = _render(study, rows, pictures, names)
    with replacing(folder / "index.html") as draft:
        draft.write_text(page, encoding="utf-8")
    return folder / "index.html"


@styled
def error_curves(
    families: Mapping[str, Sequence[SummaryRow]], limit_m: float, *, top_m: float = 5.0
) -> Figure:
    """Draw mean error against swaths and against distance, one row of panels for each terrain.

    `limit_m`: limit that is drawn strongest [m]. `top_m`: upper end of the axis of errors [m]; curves above
    are cut.
    """
    figure = Figure(figsize=(FULL_IN, 0.6 + 2.7 * len(families)), layout="constrained")
    panels = figure.subplots(len(families), 2, squeeze=False)
    for (by_swaths, by_metres), (name, rows) in zip(panels, families.items(), strict=True):
        for axes, x in ((by_swaths, "swaths"), (by_metres, "mean_length_m")):
            draw_curves(axes, rows, x, limit_m)
            axes.set_ylim(0.01, top_m)
        by_swaths.set(title=name, xlabel="Swaths", ylabel="Mean RMSE [m]")
        by_metres.set(xlabel="Distance driven [m]")
    handles, labels = panels[0, 0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=2)
    return figure


def draw_curves(
    axes: Axes, rows: Sequence[SummaryRow], x: str, limit_m: float, *, name_limits: bool = True
) -> None:
    """Draw the curves of one terrain on logarithmic errors, with the classes' limits."""
    found = curves(rows)
    planners = list(dict.fromkeys(planner for _, planner, _ in found))
    looks = {name: (ROVERS[i % len(ROVERS)], _MARKERS[i % len(_MARKERS)]) for i, name in enumerate(planners)}
    dashes = {m: _DASHES[i % len(_DASHES)] for i, m in enumerate(dict.fromkeys(k[2] for k in found))}
    for (_, planner, map_name), points in found.items():
        at = np.array([point[x] for point in points], dtype=float)
        mean, low, high = (
            np.array([p[f"mean_rmse_m{end}"] for p in points]) for end in ("", "_low", "_high")
        )
        label = planner if len(dashes) == 1 else f"{planner}, {map_name}"
        colour, marker = looks[planner]
        axes.plot(
            at, mean, color=colour, linestyle=dashes[map_name], marker=marker, markersize=4, label=label
        )
        axes.fill_between(at, low, high, color=colour, alpha=0.18, linewidth=0)
    draw_limits(axes, limit_m, named=name_limits)
    axes.set_yscale("log")
    axes.yaxis.set_major_formatter(StrMethodFormatter("{x:g}"))
    axes.yaxis.set_minor_formatter(NullFormatter())
    axes.grid(visible=True, axis="y")


def draw_limits(axes: Axes, limit_m: float, *, named: bool = True) -> None:
    """Draw the widest limit of every class as a line, with its name where there is room."""
    widest = {row.map_class: row.limit_m for row in reversed(map_classes())}
    for name, limit in widest.items():
        chief = abs(limit - limit_m) < 1e-9
        axes.axhline(
            limit, color=INK if chief else MUTED, linewidth=1.2 if chief else 0.6, linestyle=(0, (2, 2))
        )
        if not named:
            continue
        axes.annotate(
            f"{name}, {limit:.4f} m",
            (1.0, limit),
            xycoords=("axes fraction", "data"),
            ha="right",
            va="bottom" if chief else "top",
            fontsize=8,
        )


def _render(
    study: StudyConfig, rows: Sequence[SummaryRow], pictures: dict[str, Picture], names: dict[str, str]
) -> str:
    settings = tomlkit.dumps(study.model_dump(mode="json", exclude_none=True))
    minimum = [_shown_minimum(row) for row in minimum_swaths(rows, study)]
    return render(
        "montecarlo.html.j2",
        title=study.name,
        trials=study.trials,
        fidelity=study.fidelity,
        limit=number(study.limit_m, "m", 4),
        required=study.require.replace("class-", "Class "),
        pictures=pictures,
        files=names,
        minimum=minimum,
        minimum_rows=_as_rows(minimum),
        table_rows=_as_rows(rows),
        table=[_shown(row) for row in rows],
        config_text=settings,
    )


def _as_rows(rows: Sequence[SummaryRow]) -> list[list[object]]:
    """Return names and values of a table, for its download."""
    return [list(rows[0]), *(list(row.values()) for row in rows)] if rows else []


def _shown_minimum(row: SummaryRow) -> SummaryRow:
    return {key: "–" if value is None else value for key, value in row.items()}


def _shown(row: SummaryRow) -> SummaryRow:
    lengths = (
        "mean_rmse_m",
        "mean_rmse_m_low",
        "mean_rmse_m_high",
        "median_rmse_m",
        "p95_rmse_m",
        "pooled_rmse_m",
        "mean_claimed_m",
    )
    return {
        **row,
        **{name: number(row[name], "m") for name in lengths},
        "mean_length_m": number(row["mean_length_m"], "m", 0),
        **{name: percent(row[name]) for name in ("pass_share", "pass_share_low", "pass_share_high")},
    }
