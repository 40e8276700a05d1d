"""Drives in the vision fidelity, from the mission to the recording, and how they end."""

import hashlib

import numba
import numpy as np
import pytest

from benchmarks.small_inputs import BARE_SCENERY
from sim.config.mission import MissionConfig
from sim.simulate.navigator import PoseEstimate
from sim.simulate.simulated_drive import Ending
from sim.simulate.vision import simulate_vision
from survey.core.config import validated
from survey.core.errors import ConfigError, InputError
from survey.data.dem import Dem
from survey.data.grid import Grid
from survey.data.recording import Recording
from survey.data.route import Leg, Route
from survey.data.truth import Truth
from survey.interchange.layouts import write_euroc

SIZE_M = 24.0


def mission(**sections):
    content = {
        "schema_version": 1,
        "name": "drive",
        "seed": 5,
        "fidelity": "vision",
        "terrain": {"source": "random"},
        "planner": {"pattern": "lawnmower", "swaths": 1},
        "rover": {"mass_kg": 18.0, "idle_w": 20.0},
        "scenery": BARE_SCENERY,
        "imaging": {"width": 96, "height": 72},
    }
    for name, section in sections.items():
        content[name] = section if isinstance(section, list) else {**content.get(name, {}), **section}
    return validated(MissionConfig, content, "the test")


def ground(height=lambda x: 0.02 * x):
    grid = Grid((0.0, 0.0, SIZE_M, SIZE_M), 0.25, "EPSG:32608")
    east = np.tile(np.arange(0.0, SIZE_M + 0.1, 0.25), (97, 1))
    return Dem.on(grid, height(east) + 100.0)


def route(*waypoints):
    return Route((Leg("swath", np.array(waypoints, dtype=float)),), "EPSG:32608", "test")


SHORT = route((6.0, 12.0), (10.0, 12.0), (10.0, 14.0))


@pytest.fixture(scope="module")
def drive(tmp_path_factory):
    folder = tmp_path_factory.mktemp("drive")
    done = simulate_vision(ground(), SHORT, mission(), folder / "recording")
    done.write(folder)
    return done, folder


def test_a_drive_arrives_and_its_recording_reads_back(drive):
    done, folder = drive
    assert done.ending is Ending.ARRIVED
    recording = Recording.read(folder / "recording")
    times = recording.frames.time_s
    assert np.diff(times) == pytest.approx(np.full(len(times) - 1, 0.25))
    assert recording.frames[3].shape == (72, 96)
    assert np.diff(recording.inertial.time_s) == pytest.approx(
        np.full(len(recording.inertial) - 1, 1.0 / 80.0)
    )
    truth = Truth.read(folder / "truth").trajectory
    assert truth.time_s[0] <= times[0]
    assert times[-1] <= truth.time_s[-1]
    assert truth.position[-1, :2] == pytest.approx([10.0, 14.0], abs=0.6)  # within the goal's radius
    rolled = 0.5 * (recording.wheels.left_m[-1] + recording.wheels.right_m[-1])
    assert rolled > truth.length_m * 0.98  # tracks slip and count 1.5 % too much
    for product in ("preview.mp4", "contact_sheet.png", "drive.json"):
        assert (folder / product).stat().st_size > 100


def test_the_recording_holds_nothing_that_only_the_simulator_knows(drive):
    _, folder = drive
    names = {file.name for file in (folder / "recording").rglob("*") if file.suffix != ".png"}
    assert names == {
        *("recording.json", "camera.toml", "frames", "frames.csv", "rgb.txt"),
        *(f"{s}.csv" for s in ("gps", "barometer", "wheels", "inertial", "compass", "weather")),
    }


def test_the_same_seed_gives_the_same_bytes_with_one_and_two_threads(drive, tmp_path):
    _, folder = drive
    before = numba.get_num_threads()
    numba.set_num_threads(min(2 if before == 1 else 1, numba.config.NUMBA_NUM_THREADS))
    try:
        simulate_vision(ground(), SHORT, mission(), tmp_path / "recording").write(tmp_path)
    finally:
        numba.set_num_threads(before)

    def digests(place):
        files = sorted(file for file in place.rglob("*") if file.is_file())
        return {f.relative_to(place): hashlib.sha256(f.read_bytes()).hexdigest() for f in files}

    assert digests(tmp_path / "recording") == digests(folder / "recording")
    assert digests(tmp_path / "truth") == digests(folder / "truth")


def test_others_read_the_recording(drive, tmp_path):
    from vision_slam.recordings import read_sequence

    done, folder = drive
    tum = read_sequence(folder / "recording")
    write_euroc(done.recording, tmp_path / "euroc", done.truth.trajectory)
    euroc = read_sequence(tmp_path / "euroc")
    for sequence in (tum, euroc):
        assert sequence.frames.time_s == pytest.approx(done.recording.frames.time_s, abs=1e-6)
        assert (sequence.frames[2] == done.recording.frames[2]).all()
    assert euroc.inertial.gyro_rad_s == pytest.approx(done.recording.inertial.gyro_rad_s)
    assert euroc.camera.model == done.recording.camera.model
    assert euroc.camera.matrix == pytest.approx(done.recording.camera.matrix)
    assert euroc.camera.distortion == pytest.approx(done.recording.camera.distortion)
    assert euroc.reference[-1, :3, 3] == pytest.approx(done.truth.trajectory.position[-1])


@pytest.mark.parametrize(
    ("name", "terrain", "way", "settings", "endings"),
    [
        (
            "crevasse",
            ground(lambda x: np.where(np.abs(x - 10.0) < 0.55, -4.0, 0.0)),
            route((6.0, 12.0), (16.0, 12.0)),
            {},
            {Ending.FELL, Ending.TIPPED_OVER, Ending.STALLED},
        ),
        ("battery", ground(), SHORT, {"rover": {"battery_j": 60.0, "mass_kg": 18.0}}, {Ending.BATTERY_EMPTY}),
    ],
)
def test_a_drive_that_fails_ends_in_a_named_state_with_what_it_has(
    tmp_path, name, terrain, way, settings, endings
):
    done = simulate_vision(terrain, way, mission(**settings), tmp_path / "recording")
    done.write(tmp_path)
    assert done.ending in endings
    assert len(Recording.read(tmp_path / "recording").frames) > 4


def test_faults_reach_the_recording(tmp_path):
    faults = [
        {"component": "camera", "failure": "whiteout", "from_s": 1.0, "until_s": 2.0},
        {"component": "camera", "failure": "dropped", "from_s": 2.0, "until_s": 3.0},
        {"component": "camera", "failure": "frozen", "from_s": 3.0, "until_s": 4.0},
        {"component": "gps", "failure": "off", "from_s": 2.0, "until_s": 4.0},
        {"component": "start", "failure": "kidnapped"},
        {"component": "calibration", "failure": "focal-length"},
    ]
    settings = {"faults": faults, "physics": {"engine": "kinematic"}}
    done = simulate_vision(ground(), SHORT, mission(**settings), tmp_path / "recording")
    recording = done.recording
    images = {round(t * 4): recording.frames[k] for k, t in enumerate(recording.frames.time_s)}
    assert images[5].mean() > 220
    assert set(range(8, 12)).isdisjoint(images)
    assert (images[13] == images[12]).all()
    assert (images[12] == images[7]).all()
    assert set(recording.gps.time_s[:5]) >= {0.0, 1.0, 4.0}
    assert not {2.0, 3.0} & set(recording.gps.time_s)
    assert np.hypot(*(recording.start - done.truth.trajectory.position[0])[:2]) == pytest.approx(30.0)
    assert recording.camera.matrix[0, 0] > 1.004 * 48.0 / np.radians(50.0)


def test_a_carried_rover_records_nothing_and_its_wheels_stand(tmp_path):
    faults = [
        {"component": "rover", "failure": "carried", "from_s": 2.0, "until_s": 4.0},
        {"component": "calibration", "failure": "wheels", "strength": 0.1},
        {"component": "calibration", "failure": "pitch", "strength": 2.0},
    ]
    usual = {"physics": {"engine": "kinematic"}}
    plain = simulate_vision(ground(), SHORT, mission(**usual), tmp_path / "plain").recording
    faulty = simulate_vision(ground(), SHORT, mission(**usual, faults=faults), tmp_path / "carried").recording
    for name in ("frames", "gps", "inertial", "wheels", "compass", "barometer"):
        times, all_times = getattr(faulty, name).time_s, getattr(plain, name).time_s
        np.testing.assert_array_equal(times, all_times[(all_times < 2.0) | (all_times >= 4.0)])
    left = np.interp([1.9, 4.1], faulty.wheels.time_s, faulty.wheels.left_m)
    real = np.interp([1.9, 1.95, 4.0, 4.1], plain.wheels.time_s, plain.wheels.left_m)
    # Ticks of 1 mm, and the step of 5 cm between the last reading and the lifting, bound what may differ.
    assert left[1] - left[0] == pytest.approx(1.1 * (real[1] - real[0] + real[3] - real[2]), abs=0.06)
    assert faulty.wheels.left_m[-1] < 1.1 * (plain.wheels.left_m[-1] - 1.5)
    ahead = [recording.camera.T_body_camera[:3, 2] for recording in (plain, faulty)]
    assert np.degrees(np.arccos(ahead[0] @ ahead[1])) == pytest.approx(2.0)
    assert ahead[1][2] < ahead[0][2]


class GpsNavigator:
    """A navigator that assumes a good receiver and a good compass."""

    def __init__(self):
        self.seen = []
        self._belief = PoseEstimate(np.array([6.0, 12.0]), 0.0)

    def step(self, readings):
        self.seen.append(readings)
        xy = self._belief.xy if readings.gps is None else readings.gps.position[-1, :2]
        heading = self._belief.heading_rad if readings.compass is None else readings.compass.heading_rad[-1]
        self._belief = PoseEstimate(xy, float(heading))
        return self._belief

    def finish(self, readings):
        assert readings.frame is None


def test_a_rover_steers_by_what_its_navigator_estimates(tmp_path):
    settings = {
        "physics": {"engine": "kinematic"},
        "instruments": {
            "gps": {"profile": "rtk", "rate_hz": 5.0},
            "compass": {"hard_iron_deg": 0.0, "soft_iron_deg": 0.0, "white_sigma_deg": 0.2},
        },
    }
    navigator = GpsNavigator()
    done = simulate_vision(ground(), SHORT, mission(**settings), tmp_path / "recording", lambda _: navigator)
    assert done.ending is Ending.ARRIVED
    assert all(readings.frame is not None for readings in navigator.seen)
    shifted = GpsNavigator()
    step = shifted.step
    shifted.step = lambda readings: PoseEstimate(step(readings).xy + [0.0, 2.0], shifted._belief.heading_rad)
    away = simulate_vision(ground(), SHORT, mission(**settings), tmp_path / "shifted", lambda _: shifted)
    assert away.truth.trajectory.position[-1, 1] < 12.6  # it estimates itself 2 m north of where it is


def test_bad_drives_are_refused_before_anything_is_written(tmp_path):
    with pytest.raises(InputError, match=r"comes at \(40.0, 12.0\)"):
        simulate_vision(ground(), route((6.0, 12.0), (40.0, 12.0)), mission(), tmp_path / "a")
    assert not (tmp_path / "a").exists()
    (tmp_path / "b").mkdir()
    (tmp_path / "b" / "notes.txt").write_text("mine")
    with pytest.raises(InputError, match="exists and is not empty"):
        simulate_vision(ground(), SHORT, mission(), tmp_path / "b")
    with pytest.raises(ConfigError, match="must be a multiple of 80"):
        simulate_vision(ground(), SHORT, mission(physics={"rate_hz": 100}), tmp_path / "c")
    with pytest.raises(ConfigError, match="must divide 80"):
        simulate_vision(ground(), SHORT, mission(instruments={"inertial": {"rate_hz": 60.0}}), tmp_path / "c")


@pytest.mark.parametrize(
    ("section", "said"),
    [
        ({"instruments": {"frame_rate_hz": 0.0}}, "frame_rate_hz"),
        ({"faults": [{"component": "gps", "failure": "whiteout"}]}, "gps has the failures off, frozen"),
        (
            {"faults": [{"component": "gps", "failure": "off", "from_s": 3.0, "until_s": 2.0}]},
            "end after it begins",
        ),
        ({"instruments": {"gps": {"profile": "magic"}}}, "profile"),
    ],
)
def test_bad_settings_are_refused(section, said):
    with pytest.raises(ConfigError, match=said):
        mission(**section)


def test_a_drive_without_fixes_says_so(tmp_path):
    settings = {"faults": [{"component": "gps", "failure": "off"}], "physics": {"engine": "kinematic"}}
    with pytest.raises(InputError, match="fewer than two GPS fixes"):
        simulate_vision(ground(), SHORT, mission(**settings), tmp_path / "recording")
