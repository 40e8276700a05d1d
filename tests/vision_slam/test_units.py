"""Inertial readings and encoders in other units and axes."""

import numpy as np
import pytest

from survey.core.arrays import FloatArray
from survey.core.errors import InputError
from survey.data.sensors.records import Inertial, Wheels
from vision_slam.recordings import refuse_other_units

TIMES = np.arange(0.0, 60.0, 0.02)
ROLLED = Wheels(TIMES, TIMES, TIMES)


def _readings() -> tuple[FloatArray, FloatArray]:
    """Rates that reach 0.5 rad/s, and the force on a rough slope of 20 degrees."""
    rng = np.random.default_rng(4)
    gyro = np.column_stack([np.zeros((len(TIMES), 2)), 0.5 * np.sin(0.2 * TIMES)])
    slope = 9.81 * np.array([np.sin(np.radians(20.0)), 0.0, np.cos(np.radians(20.0))])
    return gyro, slope + 3.0 * rng.standard_normal((len(TIMES), 3))


@pytest.mark.parametrize(
    ("gyro_factor", "force_factor", "words"),
    [
        (np.degrees(1.0), 1.0, "in degrees per second, multiply them by 0.0174533"),
        (1.0, 1.0 / 9.81, "it is in g, multiply it by 9.81"),
        (1.0, 0.03, "record it with gravity"),
        (1.0, 1000.0, "write m/s²"),
        (1.0, np.array([1.0, -1.0, -1.0]), "x forward, y right, z down, change the sign of y and z"),
    ],
)
def test_other_units_and_axes_are_refused_with_what_to_do(
    gyro_factor: float, force_factor: float, words: str
) -> None:
    gyro, force = _readings()
    refuse_other_units(Inertial(TIMES, gyro, force), None)
    with pytest.raises(InputError, match=words):
        refuse_other_units(Inertial(TIMES, gyro_factor * gyro, force_factor * force), ROLLED)


def test_a_unit_that_lies_on_its_side_is_refused_and_one_without_accelerometer_is_not() -> None:
    gyro, force = _readings()
    with pytest.raises(InputError, match="turn gyro and force into the axes of the body"):
        refuse_other_units(Inertial(TIMES, gyro, force[:, [2, 0, 1]]), ROLLED)
    refuse_other_units(Inertial(TIMES, gyro, np.zeros_like(force)), ROLLED)


def test_a_unit_on_its_side_without_wheels_is_that_of_the_mounting() -> None:
    gyro, force = _readings()
    refuse_other_units(Inertial(TIMES, gyro, force[:, [2, 0, 1]]), None)


def test_ticks_are_refused_and_coarse_encoders_are_not() -> None:
    """Encoders of 5 cm a tick are read every millisecond, at 1 m/s after a stand of 100 s."""
    times = np.arange(0.0, 110.0, 1e-3)
    rolled = 0.05 * np.floor(np.clip(times - 100.0, 0.0, None) / 0.05)
    refuse_other_units(None, Wheels(times, rolled, rolled))
    refuse_other_units(None, Wheels([0.0, 0.1], [0.0, 0.1], [0.0, 0.1]))
    with pytest.raises(
        InputError, match=r"a median of 50 m/s.* ticks or millimetres, convert them to metres"
    ):
        refuse_other_units(None, Wheels(times, 50.0 * rolled, 50.0 * rolled))


def test_degrees_per_second_are_refused_on_a_drive_with_one_slow_turn_and_outliers_are_not() -> None:
    """90 degrees in 9 s of 400 s."""
    times = np.arange(0.0, 400.0, 0.02)
    gyro = np.zeros((len(times), 3))
    gyro[(times >= 200.0) & (times < 209.0), 2] = np.radians(10.0)
    level = np.tile([0.0, 0.0, 9.81], (len(times), 1))
    with pytest.raises(InputError, match=r"turns at 10\.0 rad/s for seconds"):
        refuse_other_units(Inertial(times, np.degrees(gyro), level), None)
    gyro[::500] = 1e3
    refuse_other_units(Inertial(times, gyro, level), None)


def test_wheels_of_which_one_side_counts_backward_are_refused() -> None:
    refuse_other_units(None, Wheels(TIMES, TIMES, 0.7 * TIMES))
    refuse_other_units(None, Wheels(TIMES, 0.2 * TIMES, -0.2 * TIMES))  # 12 m on the spot
    with pytest.raises(InputError, match="in opposite directions from the start to the end; change the sign"):
        refuse_other_units(None, Wheels(TIMES, TIMES, -0.98 * TIMES))
