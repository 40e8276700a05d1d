"""Localization from images beside other programs on the same images: ``python -m benchmarks.peers_in_vision``.

Drives are the recorded streets of the shared data (FIRNLINE_DATA) and simulated ones over snow at 4 images a second, two of
60 m, one of them also at 10, and one of 590 m with ten turns. Programs are ours, ORB-SLAM3 (``pyorbslam3``), COLMAP (``pycolmap``), both of the extra ``peers``, and an odometry of
OpenCV's functions; ``FIRNLINE_PEERS`` names another Python that has the two. All get images and calibration alone; ours gets
the travel of the reference's first 10 m besides, which its covariances need.

Settings: ours are the defaults. ORB-SLAM3 has those that it ships for KITTI and a vocabulary that is trained here on every
sixth image of all drives, and gets the images as in real time on a machine of its own; of three runs on a street the one
with the median error counts. COLMAP matches each image with ten neighbours and refines the lens; SIFT finds at most 2000
corners, and it gets every second image of a short street and every fourth of a long one, 50 in all: more take it many
minutes. Its first pair may look ahead and have an angle of 4°. It runs on streets alone.

Every path is turned by its first pose and scaled by the reference's first 10 or 40 m. Errors are over the images that have a
pose, up to the last of them. What a program found is stored, so that a run goes on where it was, and another version of ours
does not run the others again.
"""

import sys
from collections.abc import Iterator

import cv2

from benchmarks.peers_in_vision.drives import PeerDrive, drives
from benchmarks.peers_in_vision.figure import error_figure
from benchmarks.peers_in_vision.programs import OURS, found_paths, programs_for
from benchmarks.peers_in_vision.scores import PathScore, median_run
from benchmarks.report import Row, main
from benchmarks.writer import TABLES
from survey.figures.style import png_bytes


def measure(quick: bool) -> Iterator[Row]:
    """Yield the rows of every drive; draw the figure of a full run."""
    scores: list[PathScore] = []
    for drive in drives(quick=quick):
        mine = [median_run(drive, program, found_paths(drive, program)) for program in programs_for(drive)]
        for score in mine:
            yield from score.rows()
        yield from _beside_the_best(drive, mine)
        scores += mine
    if not scores:
        sys.exit("the recorded drives are not here; set FIRNLINE_DATA.")
    if not quick:
        (TABLES / "peers_in_vision.png").write_bytes(png_bytes(error_figure(scores)))


def _beside_the_best(drive: PeerDrive, scores: list[PathScore]) -> Iterator[Row]:
    """Yield our error of shape over the least of the others that follow the drive."""
    own = next(score for score in scores if score.program == OURS)
    others = [score.ate_m for score in scores if score is not own and score.is_followed]
    if others:
        name = (
            f"{drive.name}: Sim(3) ATE over the least of the others that lose at most a tenth of the images"
        )
        yield Row.of(name, own.ate_m / min(others), "x", "<=", 1.0)


if __name__ == "__main__":
    cv2.setNumThreads(1)
    main("Peers in vision", measure, ("numpy", "gtsam", "opencv-python-headless"))
