"""Places recognized from any heading, on drawn ground whose poses are known."""

import numpy as np
import pytest
from pyproj import CRS
from scipy.spatial.transform import Rotation

from survey.core.arrays import FloatArray
from survey.core.errors import InputError
from survey.data.camera import Camera
from survey.data.frames import Frames
from survey.data.recording import Recording
from survey.data.sensors.odometry import Odometry, Sightings
from survey.data.sensors.records import GpsFixes
from vision_slam.places.ground_view import GroundMosaics, GroundView, match_overlay
from vision_slam.places.loop_closures import detect_loop_closures
from vision_slam.places.relocalization import match_ground

STEP_M = 0.25
NO_LANDMARKS = Sightings(np.zeros(0, np.int64), np.zeros((0, 3)), np.zeros((0, 3, 3)), np.zeros(0))


def _loop() -> tuple[FloatArray, FloatArray]:
    """East for 6 m, round a square, and back over the first leg from the south: places (N, 3), headings (N,)."""
    legs = [(0.0, 6.0), (90.0, 3.0), (180.0, 3.0), (270.0, 6.0)]
    place, places, headings = np.zeros(3), [], []
    for heading_deg, length_m in legs:
        ahead = np.array([np.cos(np.radians(heading_deg)), np.sin(np.radians(heading_deg)), 0.0])
        for _ in range(round(length_m / STEP_M)):
            places.append(place)
            headings.append(np.radians(heading_deg))
            place = place + STEP_M * ahead
    return np.array(places), np.unwrap(np.array(headings))


def _odometry(places: FloatArray, headings: FloatArray) -> Odometry:
    level = np.zeros_like(headings)
    attitude = np.column_stack([level, level, headings])
    turn = Rotation.from_euler("xyz", attitude).as_matrix()
    steps = np.einsum("nji,nj->ni", turn[:-1], np.diff(places, axis=0))
    return Odometry(np.linspace(0.0, 0.25 * (len(places) - 1), len(places)), steps, attitude)


def _pose(place: FloatArray, heading_rad: float) -> FloatArray:
    pose = np.eye(4)
    pose[:3, :3] = Rotation.from_euler("z", heading_rad).as_matrix()
    pose[:3, 3] = place
    return pose


@pytest.fixture(scope="module")
def drive(plane_world: object, camera: Camera) -> Recording:
    places, headings = _loop()
    odometry = _odometry(places, headings)
    images = [
        plane_world.image(_pose(place, heading))  # type: ignore[attr-defined]
        for place, heading in zip(places, headings, strict=True)
    ]
    fixes = GpsFixes(odometry.time_s[[0, -1]], places[[0, -1]])
    frames = Frames(odometry.time_s, images)
    return Recording(
        CRS("EPSG:32608"),
        places[0],
        fixes,
        odometry=odometry,
        sightings=NO_LANDMARKS,
        camera=camera,
        frames=frames,
    )


def test_a_crossing_is_recognized_from_another_heading(drive: Recording) -> None:
    places, headings = _loop()
    # A path that has drifted by half a metre since, and knows that it may have.
    drifted = places + np.linspace(0.0, 0.5, len(places))[:, None] * [1.0, 0.0, 0.0]
    found = detect_loop_closures(drive, drifted, np.full(len(places), 0.3))
    assert found is not None
    earlier = np.searchsorted(drive.odometry.time_s, found.earlier_s)  # type: ignore[union-attr]
    later = np.searchsorted(drive.odometry.time_s, found.time_s)  # type: ignore[union-attr]
    assert (np.abs(headings[later] - headings[earlier]) > 1.0).all()
    turn = Rotation.from_euler("z", headings[earlier][:, None]).as_matrix()
    real = np.einsum("nji,nj->ni", turn, places[later] - places[earlier])
    # A cell of the view is 2.5 cm wide, and features of two views differ by about as much.
    assert np.abs(found.offset - real).max() < 0.05


def test_nothing_is_recognized_where_the_path_cannot_have_met_itself(drive: Recording) -> None:
    places, _ = _loop()
    straight = np.column_stack([STEP_M * np.arange(len(places)), np.zeros((len(places), 2))])
    assert detect_loop_closures(drive, straight, np.full(len(places), 0.3)) is None


def test_other_ground_is_not_taken_for_the_same(drive: Recording) -> None:
    places, _ = _loop()
    assert drive.odometry is not None
    assert drive.frames is not None
    assert drive.camera is not None
    mosaics = GroundMosaics(drive.frames, drive.camera, places, drive.odometry, NO_LANDMARKS)
    overlay = match_overlay(mosaics.around(12), mosaics.around(40))
    assert overlay is None or overlay.n_agree < 10


def test_a_rover_that_knows_nothing_of_its_place_finds_it_by_the_ground(drive: Recording) -> None:
    places, headings = _loop()
    odometry = drive.odometry
    assert odometry is not None
    assert drive.frames is not None
    assert drive.camera is not None
    # The last leg is reckoned from nowhere, under a heading of its own.
    last = len(places) - 20
    lost, turned = places.copy(), headings.copy()
    lost[last:] = (places[last:] - places[last]) @ _pose(np.zeros(3), 1.0)[:3, :3].T + [500.0, 70.0, 0.0]
    turned[last:] += 1.0
    attitude = odometry.attitude_rad * [1.0, 1.0, 0.0] + turned[:, None] * [0.0, 0.0, 1.0]
    reckoned = Odometry(odometry.time_s, odometry.step, attitude)
    mosaics = GroundMosaics(drive.frames, drive.camera, lost, reckoned, NO_LANDMARKS)
    met = match_ground(mosaics, np.arange(14, 24), np.arange(last + 10, last + 14))
    assert met is not None
    earlier, later, overlay = met
    level = Rotation.from_euler("z", headings[earlier]).as_matrix()
    np.testing.assert_allclose(overlay.shift, level.T @ (places[later] - places[earlier]), atol=0.05)
    assert abs(np.exp(1j * (overlay.turn_rad - headings[later] + headings[earlier])) - 1.0) < 0.03


def test_needs_images_that_were_processed(drive: Recording) -> None:
    bare = Recording(drive.crs, drive.start, drive.gps)
    with pytest.raises(InputError, match="recognized on images"):
        detect_loop_closures(bare, np.zeros((2, 3)), np.ones(2))


def _view(xyz: FloatArray, likeness: FloatArray) -> GroundView:
    descriptors = likeness / np.linalg.norm(likeness, axis=1, keepdims=True)
    return GroundView(0, xyz, descriptors.astype(np.float32))


def test_finds_turn_shift_and_height_among_false_matches() -> None:
    rng = np.random.default_rng(5)
    here = rng.uniform(-2.5, 2.5, (120, 3)) * [1.0, 1.0, 0.05]
    looks = np.abs(rng.normal(size=(120, 128)))
    turn, shift = 2.0, np.array([0.8, -0.4, 0.15])
    there = (here - shift) @ Rotation.from_euler("z", turn).as_matrix()
    there[:60] = rng.uniform(-2.5, 2.5, (60, 3))  # half of what looks alike lies elsewhere
    overlay = match_overlay(_view(here, looks), _view(there + 0.01 * rng.normal(size=(120, 3)), looks))
    assert overlay is not None
    assert overlay.n_agree >= 58
    # 1 cm of noise on 60 features: 2 mm.
    np.testing.assert_allclose(overlay.shift, shift, atol=0.006)
    assert abs(overlay.turn_rad - turn) < 0.003


def test_chance_makes_few_matches_agree() -> None:
    rng = np.random.default_rng(6)
    looks = np.abs(rng.normal(size=(150, 128)))
    views = [_view(rng.uniform(-2.5, 2.5, (150, 3)), looks) for _ in range(2)]
    overlay = match_overlay(*views)
    assert overlay is None or overlay.n_agree < 12
