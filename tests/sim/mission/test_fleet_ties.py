"""Ties between the rovers of a mission: found by images alone, and used where they were found."""

import numpy as np

from sim.config.mission import MissionConfig
from sim.mission.drives import mapped_points
from sim.mission.fleet import TIES_FILE, drive_folders, n_ties, tied_drives
from sim.mission.runs import open_run
from sim.mission.stages import run_mission
from survey import Trajectory
from survey.core.config import validated
from survey.data.sensors.odometry import DriveTies
from survey.reconstruction.joint.drives import SeveralDrives
from tests.sim.mission.test_fleet import TWO


def test_rovers_are_tied_by_the_places_in_the_file(tmp_path):
    mission = validated(MissionConfig, TWO, "the test")
    run = open_run(mission, tmp_path)
    run_mission(mission, run, until="localize", workers=1)
    localized = run.folder("localize")
    assert not (localized / TIES_FILE).exists()
    places = drive_folders(localized)
    paths = [Trajectory.read(place / "trajectory.csv", "EPSG:32608") for place in places]
    drives = SeveralDrives.of([(mapped_points(p), path.error) for p, path in zip(places, paths, strict=True)])
    assert tied_drives(drives, paths, tmp_path, mission) is drives
    middle = [len(times) // 2 for times in drives.time_s]
    moments = [times[k] for times, k in zip(drives.time_s, middle, strict=True)]
    one, other = (
        path.position[np.searchsorted(path.time_s, at)] for path, at in zip(paths, moments, strict=True)
    )
    off = np.array([0.3, -0.2, 0.1])
    tie = DriveTies([moments[0]], [0], [1], [moments[1]], [other - one - off], [1e-4 * np.eye(3)])
    tie.write(tmp_path / TIES_FILE)
    assert (n_ties(localized, 2), n_ties(tmp_path, 2)) == ([0, 0], [1, 1])
    tied = tied_drives(drives, paths, tmp_path, mission)
    assert tied.shift is not None
    first, second = tied.shift[middle[0]], tied.shift[len(drives.time_s[0]) + middle[1]]
    np.testing.assert_allclose(second - first, off, atol=0.02)
