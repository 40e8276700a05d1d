"""From swaths to a drivable tour: ordering, turns, energy, fleets.

Nothing here depends on the map that the survey will give.
"""
