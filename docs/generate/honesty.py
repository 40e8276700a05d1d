"""Table of the figures of honest maps: each with the command that measures it and the value that is stored."""

from typing import Any

from generate.benchmarks import described, escaped, number, stored_tables
from generate.tables import table

FIGURES = {
    "honesty": (
        "truthful: coverage of 95 %, mean over surveys",
        "truthful, stated so: coverage of 95 %, mean over surveys",
        "datum 0.5 m: coverage of 95 %, mean over surveys",
        "shift 7 m: coverage of 95 %, mean over surveys",
        "correlated 3 m: coverage of 95 %, mean over surveys",
        "all together: coverage of 95 %, mean over surveys",
        "wrong stated sigma: coverage of 95 %, mean over surveys",
        "all together, other sensors: coverage of 95 %",
        "worst terrain and prior",
        "tenths of the probability integral, least",
        "tenths of the probability integral, greatest",
        "posterior of RMSE, absolute: share of maps above its 95 % limit",
        "posterior of RMSE, relative: share of maps above its 95 % limit",
        "posterior of RMSE: false certificates",
        "posterior of RMSE: maps that meet Class 3 and are not certified",
        "expected RMSE alone: false certificates",
        "truthful: RMSE over that of an oracle",
        "truthful, stated so: RMSE over that of an oracle",
        "datum 0.5 m: RMSE over that of an oracle",
        "shift 7 m: RMSE over that of an oracle",
        "correlated 3 m: RMSE over that of an oracle",
        "all together: RMSE over that of an oracle",
        "wrong stated sigma: RMSE over that of an oracle",
        "datum 0.5 m: RMSE over that without a prior",
        "shift 7 m: RMSE over that without a prior",
        "correlated 3 m: RMSE over that without a prior",
        "all together: RMSE over that without a prior",
        "wrong stated sigma: RMSE over that without a prior",
        "moraine ridges, truthful: RMSE over that of e7dc4dd, on its worst survey",
        "moraine ridges, truthful: coverage",
        "anisotropic ridges, truthful: RMSE over that of e7dc4dd, on its worst survey",
        "anisotropic ridges, truthful: coverage",
        "SRTM windows, truthful: RMSE over that of e7dc4dd",
        "SRTM windows, truthful: RMSE over that of e7dc4dd, without the offset of each map",
        "SRTM windows, truthful, stated so: RMSE over that of e7dc4dd",
    ),
    "mismatch": (
        "no prior, assumptions as drawn: coverage of 95 %, mean",
        "no prior, assumptions off by up to 2: coverage of 95 %, mean",
        "no prior, assumptions off by up to 2: coverage of 95 %, worst",
        "no prior: RMSE over that of right assumptions, median of surveys",
        "truthful prior, assumptions as drawn: coverage of 95 %, mean",
        "truthful prior, assumptions off by up to 2: coverage of 95 %, mean",
        "truthful prior, assumptions off by up to 2: coverage of 95 %, worst",
        "truthful prior: RMSE over that of right assumptions, median of surveys",
    ),
    "honest_missions": (
        "unbiased prior, stated so, no stakes: coverage of 95 %, mean",
        "unbiased prior, stated so, no stakes: coverage of 95 %, worst mission",
        "unbiased prior, stated so, no stakes: coverage of 95 %, single swaths",
        "unbiased prior, stated so: RMSE over that of the code of e7dc4dd",
        "prior with the errors of copernicus-30, 4 stakes: coverage of 95 %, mean",
        "prior with the errors of copernicus-30, no stakes: coverage of 95 %, mean",
        "prior with the errors of copernicus-30, 4 stakes, lawnmower: RMSE, median",
        "prior with the errors of copernicus-30, no stakes, lawnmower: RMSE, median",
        "prior with the errors of copernicus-30: classes certified and false",
        "no prior, no stakes: coverage of 95 %, mean",
        "no prior, no stakes: coverage of 95 %, worst mission",
        "unbiased prior, stated so: swaths left out, beyond 5 m, within 95 %",
        "no prior: swaths left out, beyond 5 m, within 95 %",
        "CPU time of the fit of the kernel over that of the code of e7dc4dd",
    ),
    "held_out_swaths": (
        "images, with a satellite: swaths left out, beyond 5 m, within 95 %",
        "images, without a satellite: swaths left out, beyond 5 m, within 95 %",
        "kernels without landforms: contradicted by swaths left out",
        "paths that state a tenth of their error: contradicted by swaths left out",
    ),
    "volume_intervals": (
        "all filters: 95 % interval holds",
        "errors filtered by 0 cells: half width / true one, median",
        "errors filtered by 2 cells: half width / true one, median",
        "errors filtered by 16 cells: half width / true one, median",
    ),
}
"""Beginnings of the names of rows, by the stored table that holds them."""
_HEAD = """\
# Honesty of maps

What is measured of the standard deviations of maps, priors, certificates and volumes, with the command that measures it.
All rows are in the [tables of the benchmarks](benchmarks/index.md); [](../explanation/sigma.md) states what is claimed.

"""


def pages() -> dict[str, str]:
    """Return the page."""
    tables = stored_tables()
    rows = [
        _row(stem, _found(tables[stem]["rows"], name))
        for stem, names in FIGURES.items()
        if stem in tables
        for name in names
    ]
    return {"reference/honesty.md": _HEAD + table(("figure", "command", "value", "limit", "met"), rows)}


def _found(rows: list[dict[str, Any]], name: str) -> dict[str, Any]:
    """Return the row of a name, or the only one that begins with it."""
    return next((one for one in rows if one["name"] == name), None) or next(
        one for one in rows if one["name"].startswith(name)
    )


def _row(stem: str, item: dict[str, Any]) -> tuple[str, str, str, str, str]:
    met = {True: "yes", False: "**missed**", None: ""}[item["holds"]]
    unit = "" if item["unit"] == "1" else f" {item['unit']}"
    return escaped(item["name"]), described(stem)[1], number(item["value"]) + unit, item["bar"], met
