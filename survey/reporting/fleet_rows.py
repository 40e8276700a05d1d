"""Table of the rovers of a fleet: swaths, distance, time, energy, ending, error of the path and ties."""

from survey.data.route import Route
from survey.reporting.quantities import number
from survey.reporting.surveyed import FleetResults, RoverDrive

HEADINGS = (
    "Rover", "Swaths", "Distance", "Time", "Energy", "Ending", "Error, horizontal", "Error, vertical",
    "Places shared with others",
)  # fmt: skip
_J_PER_KJ = 1e3


def fleet_rows(fleet: FleetResults | None, route: Route) -> list[list[str]]:
    """Return the heading and one row for each rover; nothing without a fleet."""
    if fleet is None:
        return []
    return [list(HEADINGS), *(_row(k, rover, route) for k, rover in enumerate(fleet.rovers))]


def _row(k: int, rover: RoverDrive, route: Route) -> list[str]:
    n_swaths = sum(leg.rover == k for leg in route.swaths)
    return [
        f"Rover {k + 1}",
        str(n_swaths),
        number(rover.reference_trajectory.length_m, "m", 0),
        number(rover.duration_s, "s", 0),
        number(rover.energy_j / _J_PER_KJ, "kJ", 0),
        rover.ending,
        number(rover.horizontal_rms_m, "m", 2),
        number(rover.vertical_rms_m, "m", 2),
        str(rover.n_ties),
    ]
