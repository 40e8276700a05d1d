"""Time and energy that a rover of a fleet needs for a row of swaths."""

from itertools import pairwise

import numpy as np

from planners.driving.energy import Mobility, effort
from planners.driving.swath_tours import Tours
from survey.core.arrays import IntArray
from survey.core.errors import InputError
from survey.data.dem import Dem


class FleetRows:
    """Time that a rover needs for a row of items, returns to its depot included."""

    def __init__(self, tours: Tours, mobility: Mobility, dem: Dem | None) -> None:
        self.tours, self.mobility = tours, mobility
        self.n_rovers = len(tours.depots)
        efforts = [effort(swath, mobility, dem) for swath in tours.swaths]
        self.swath_s = np.array([e.time_s for e in efforts])
        back = [effort(swath[::-1], mobility, dem) for swath in tours.swaths]
        self.swath_j = np.maximum([e.energy_j for e in efforts], [e.energy_j for e in back])
        self.memory: dict[tuple[int, bytes], float] = {}
        self._require_battery()

    def depot(self, rover: int) -> int:
        """Return the item of a rover's depot."""
        return self.tours.first_depot + 2 * rover

    def transit_s(self, a: int, b: int) -> float:
        """Return driving time and the two turns at the ends of a transit [s]."""
        length_m = self.tours.transit_m(a, b)
        return length_m / self.mobility.speed_m_s + (2.0 * self.mobility.turn_s if length_m > 0.0 else 0.0)

    def transit_j(self, a: int, b: int) -> float:
        """Return the energy of a transit on level ground [J]."""
        return self.tours.transit_m(a, b) * self.mobility.flat_j_per_m

    def _require_battery(self) -> None:
        battery_j = self.mobility.battery_j
        if battery_j is None:
            return
        for swath, energy_j in enumerate(self.swath_j):
            ends = (2 * swath, 2 * swath + 1)
            trips = [
                self.transit_j(self.depot(r), ends[0]) + self.transit_j(ends[1], self.depot(r)) + energy_j
                for r in range(self.n_rovers)
            ]
            if max(trips) > battery_j:
                x, y = self.tours.ends[ends[0]]
                raise InputError(
                    f"the swath from ({x:.1f}, {y:.1f}) and the way there and back take {max(trips) / 1e3:.0f} kJ, but the battery "
                    f"holds {battery_j / 1e3:.0f} kJ; move the depot nearer, shorten the swaths or take a larger battery."
                )

    def seconds(self, row: IntArray, rover: int) -> float:
        """Return the time from the depot along the row and back [s], as if the battery lasted."""
        if not len(row):
            return 0.0
        key = (rover, row.tobytes())
        if key not in self.memory:
            stops = [self.depot(rover), *row.tolist(), self.depot(rover)]
            driven_s = sum(self.transit_s(a ^ 1, b) for a, b in pairwise(stops))
            self.memory[key] = driven_s + float(self.swath_s[row >> 1].sum())
        return self.memory[key]

    def _trips(self, row: IntArray, rover: int) -> list[int]:
        """Return where each trip begins so that all take the least time: the shortest path over all cuts."""
        home, battery_j, n = self.depot(rover), self.mobility.battery_j, len(row)
        if battery_j is None:
            return [0]
        best, came_from = np.full(n + 1, np.inf), np.zeros(n + 1, dtype=np.int64)
        best[0] = 0.0
        for i in range(n):
            out_s, out_j = self.transit_s(home ^ 1, row[i]), self.transit_j(home ^ 1, row[i])
            for j in range(i, n):
                if j > i:
                    out_s += self.transit_s(row[j - 1] ^ 1, row[j])
                    out_j += self.transit_j(row[j - 1] ^ 1, row[j])
                out_s += self.swath_s[row[j] >> 1]
                out_j += self.swath_j[row[j] >> 1]
                if out_j > battery_j:
                    break
                total = best[i] + self.mobility.recharge_s + out_s + self.transit_s(row[j] ^ 1, home)
                fits = out_j + self.transit_j(row[j] ^ 1, home) <= battery_j
                if fits and total < best[j + 1]:
                    best[j + 1], came_from[j + 1] = total, i
        starts, at = [], n
        while at > 0:
            at = int(came_from[at])
            starts.append(at)
        return starts

    def with_returns(self, row: IntArray, rover: int) -> IntArray:
        """Return the tour of a rover: depot, swaths, and the depot again wherever it recharges."""
        home = self.depot(rover)
        starts = set(self._trips(row, rover))
        items: list[int] = []
        for i, item in enumerate(row.tolist()):
            items += [home, item] if i in starts else [item]
        return np.array(items, dtype=np.int64)
