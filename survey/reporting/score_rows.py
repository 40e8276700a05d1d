"""Rows of the table of a score."""

from survey.reporting.quantities import TableRow, number, percent
from survey.scoring import Calibration, Coverage, ErrorStatistics, Score, judge


def score_rows(score: Score) -> dict[str, list[TableRow]]:
    """Return the table of scores, grouped, each with a line that explains it."""
    return {
        "Elevation": _elevation_rows(score.elevation),
        "Uncertainty": _calibration_rows(score.calibration),
        "Coverage": _coverage_rows(score.coverage),
        "Nodes of the map": [
            TableRow(
                "Compared",
                number(score.elevation.n, decimals=0),
                "inside the area, with reference and height",
            ),
            TableRow(
                "Silent",
                number(score.n_silent, decimals=0),
                "inside the area, but without a height in the map",
            ),
            TableRow(
                "Unknown", number(score.n_unknown, decimals=0), "inside the area, but without reference"
            ),
            TableRow("Outside", number(score.n_outside, decimals=0), "outside the area, never scored"),
        ],
    }


def _elevation_rows(e: ErrorStatistics) -> list[TableRow]:
    return [
        TableRow("RMSE", number(e.rmse_m, "m"), "root mean square error; what the standards judge"),
        TableRow("Bias", number(e.bias_m, "m"), "mean error; positive: the map lies too high"),
        TableRow(
            "Standard deviation",
            number(e.std_m, "m"),
            f"relative error: what is left after removing the bias; {_relative_class(e)}",
        ),
        TableRow("Median", number(e.median_m, "m"), "half of the errors are above, half below"),
        TableRow(
            "NMAD",
            number(e.nmad_m, "m"),
            "spread without regard to outliers; for normal errors the standard deviation",
        ),
        TableRow("95th percentile of |error|", number(e.p95_m, "m"), "95 of 100 nodes err by less"),
        TableRow("Largest |error|", number(e.worst_m, "m"), "the worst node"),
        TableRow("Skewness", number(e.skewness, decimals=2), "0 for symmetric errors"),
        TableRow(
            "Excess kurtosis",
            number(e.kurtosis, decimals=2),
            "0 for normal errors, above 0 for rare large ones",
        ),
    ]


def _relative_class(e: ErrorStatistics) -> str:
    """Return the tightest class that the error without the bias meets, as text."""
    met = [verdict for verdict in judge(e.std_m) if verdict.met]
    return f"{met[-1].map_class} (limit {number(met[-1].limit_m, 'm')})" if met else "no class"


def _calibration_rows(k: Calibration) -> list[TableRow]:
    return [
        TableRow(
            "Errors within the 95% interval",
            percent(k.coverage_95),
            "95% when the standard deviation is right",
        ),
        TableRow(
            "RMS of error over claimed σ",
            number(k.z_rms, decimals=2),
            "1 when the standard deviation is right, above 1 when it is too small",
        ),
    ]


def _coverage_rows(c: Coverage) -> list[TableRow]:
    return [
        TableRow(
            "Science-centric coverage (SCC)",
            percent(c.scc),
            "share of the possible samples, far ones counting more",
        ),
        TableRow("Cells visited", percent(c.cells_share), "plain share of the possible samples"),
        TableRow(
            "Robot-centric coverage",
            number(c.robot_centric),
            "distance driven over that of visiting every cell in lines",
        ),
        TableRow(
            "Centeredness α", number(c.alpha), "0 when the samples are balanced about the centre, 1 at worst"
        ),
        TableRow("Distributedness β", number(c.beta), "0 for straight swaths; – where it is not defined"),
    ]
