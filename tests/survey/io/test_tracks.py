"""Orientations of length 0 are refused where a trajectory is read."""

import pytest

from survey import InputError
from survey.io.pose_files import read_tum


def test_a_quaternion_of_length_zero_is_refused(tmp_path):
    path = tmp_path / "path.tum"
    path.write_text("0.0 1.0 2.0 3.0 0.0 0.0 0.0 1.0\n1.0 2.0 2.0 3.0 0.0 0.0 0.0 0.0\n")
    with pytest.raises(InputError, match="pose 2"):
        read_tum(path)
