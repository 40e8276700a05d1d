"""The pictures of a report, each with its words."""

import base64
import struct
from typing import NamedTuple

import numpy as np
from matplotlib.figure import Figure

from survey import figures
from survey.core.arrays import FloatArray
from survey.data.surface_points import SurfacePoints
from survey.data.trajectory import Trajectory
from survey.reporting.surveyed import OnBoard, SurveyResults


class Picture(NamedTuple):
    """A figure as the page shows it: PNG (or animated WebP) bytes, words for those who cannot see it, a caption."""

    image: bytes
    alt: str
    caption: str

    @property
    def kind(self) -> str:
        """Its format, by its first bytes."""
        return "webp" if self.image.startswith(b"RIFF") else "png"

    @property
    def source(self) -> str:
        """The image itself as a data URI."""
        return f"data:image/{self.kind};base64," + base64.b64encode(self.image).decode("ascii")

    @property
    def size(self) -> tuple[int, int]:
        """Width and height in pixels, from the header."""
        if self.kind == "webp":
            # The extended format, which animations have, states the canvas less one, in 24 bits each.
            width, height = (int.from_bytes(self.image[at : at + 3], "little") + 1 for at in (24, 27))
            return width, height
        width, height = struct.unpack(">II", self.image[16:24])
        return int(width), int(height)


def pictures_of(survey: SurveyResults) -> dict[str, Picture]:
    """Draw all that there is to show of a survey, by the pictures' names."""
    pictures = _map_pictures(survey) | _error_pictures(survey)
    if survey.trajectory is not None and survey.reference_trajectory is not None:
        pictures |= _path_pictures(survey.trajectory, survey.reference_trajectory, survey.points)
    if survey.on_board is not None:
        pictures |= _camera_pictures(survey.on_board)
        if survey.on_board.believed is not None and survey.reference_trajectory is not None:
            pictures |= _drive_pictures(survey, survey.reference_trajectory, survey.on_board.believed)
    return pictures


def _map_pictures(survey: SurveyResults) -> dict[str, Picture]:
    """Draw what was driven, what came out, and what it rests on."""
    area, route, reconstruction = survey.area, survey.route, survey.reconstruction
    pictures = {
        "map": Picture(
            _png(figures.route_map(reconstruction.mean, area=area, route=route)),
            "Hillshaded map of the site with the route",
            "The reconstructed terrain with the route. Numbers give the order of the swaths.",
        ),
        "terrain": Picture(
            _png(figures.terrain_comparison(survey.truth, reconstruction, survey.prior, area=area)),
            "Reference and reconstruction side by side",
            "The ground as it is, as it was mapped, and as it was known before; all in the same colours."
            if survey.prior
            else "The ground as it is and as it was mapped, in the same colours.",
        ),
        "std": Picture(
            _png(figures.deviation_map(reconstruction, area=area, route=route)),
            "Map of the claimed standard deviation",
            "What the map claims to know: small along the swaths, larger between them.",
        ),
        "support": Picture(
            _png(figures.support_map(reconstruction, area=area, route=route)),
            "Map of what each node rests on",
            "What stands behind each height.",
        ),
    }
    if survey.points is not None:
        pictures["landmarks"] = Picture(
            _png(figures.landmark_map(survey.points, reconstruction.mean, area=area, route=route)),
            "Map of the density of landmarks",
            "Where the surface was measured, and how densely.",
        )
    return pictures


def _error_pictures(survey: SurveyResults) -> dict[str, Picture]:
    """Draw how far the map is from the reference, and if it knows so."""
    area, truth, route, reconstruction = survey.area, survey.truth, survey.route, survey.reconstruction
    return {
        "error": Picture(
            _png(figures.error_map(reconstruction, truth, area=area, route=route)),
            "Map of the error",
            "Red: the map lies too high, blue: too low. The limits hold 99% of the errors.",
        ),
        "profile": Picture(
            _png(figures.terrain_profile(reconstruction, truth, route, prior=survey.prior, area=area)),
            "Terrain profiles along one swath and across the survey",
            "Profiles along one swath and across the survey; below, the error inside its claimed band (± 2 σ).",
        ),
        "calibration": Picture(
            _png(figures.calibration_plot(reconstruction, truth, survey.score.calibration, area=area)),
            "Observed against claimed coverage, and errors in claimed standard deviations",
            "On the diagonal (left) and under the curve (right), claim and error agree.",
        ),
        "histogram": Picture(
            _png(figures.error_histogram(reconstruction, truth, survey.score.elevation, area=area)),
            "Histogram of the errors with RMSE, NMAD and 95th percentile",
            "How the errors are distributed.",
        ),
        "distance": Picture(
            _png(figures.error_against_distance(reconstruction, truth, route, area=area)),
            "Error against distance to the route",
            "How error and claim grow away from the route.",
        ),
    }


def _path_pictures(
    trajectory: Trajectory, reference: Trajectory, points: SurfacePoints | None
) -> dict[str, Picture]:
    """Draw where the rover believed to be, and how far off it was."""
    at_times = np.column_stack(
        [np.interp(trajectory.time_s, reference.time_s, axis) for axis in reference.position.T]
    )
    is_lost = np.asarray(trajectory.health) < 0.5
    return {
        "path": Picture(
            _png(
                figures.path_map(
                    trajectory.position,
                    trajectory.covariance,
                    landmarks=None if points is None else points.xyz,
                    landmark_sigma_m=None if points is None else points.sigma_z,
                    reference=reference.position,
                    is_lost=is_lost,
                )
            ),
            "Map of the estimated path with its 1σ ellipses, the reference and the landmarks",
            "Where the rover believed to be, how surely, and what it saw from there.",
        ),
        "path_error": Picture(
            _png(figures.error_over_distance(trajectory.position, at_times, trajectory.covariance, is_lost)),
            "Horizontal and vertical error of the position over the distance driven, with the claimed band",
            "How the error of the position grows with the distance, and what was claimed of it.",
        ),
        "trajectory": Picture(
            _png(figures.trajectory_error(trajectory, reference)),
            "Error of the estimated position over time with its claimed band",
            "Error of the estimated position: east, north and up. The band is what the rover claims (± 2 σ).",
        ),
    }


def _drive_pictures(survey: SurveyResults, driven: Trajectory, believed: FloatArray) -> dict[str, Picture]:
    """Draw how the drive kept to its plan."""
    route, paths = survey.route, (driven.position, believed)
    return {
        "executed": Picture(
            _png(figures.executed_route(route, *paths, area=survey.area)),
            "Map of the planned path and of the one that was driven",
            "Where the rover was to go, where it went, and where it thought that it was.",
        ),
        "deviation": Picture(
            _png(figures.deviation_from_route(route, *paths)),
            "Distance from the planned path over the distance driven",
            "How far from its route the rover was, and how far it thought that it was.",
        ),
    }


def _camera_pictures(on_board: OnBoard) -> dict[str, Picture]:
    """Show what the camera saw, and what was followed in its images."""
    pictures = {}
    if on_board.video is not None:
        alt = "Images of the drive, one after the other"
        pictures["video"] = Picture(on_board.video, alt, "What the camera saw, from start to end.")
    if on_board.tracks is not None:
        pictures["tracks"] = Picture(
            _png(on_board.tracks),
            "Images of the drive with the corners that were followed, before and after CLAHE",
            "What the camera followed: lines are the ways of corners, left in the images as they came, right after their contrast was raised.",
        )
    return pictures


def _png(figure: Figure) -> bytes:
    return figures.png_bytes(figure)
