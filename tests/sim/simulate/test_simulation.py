"""Simulation of a drive from terrain and route alone, in each fidelity."""

import numpy as np
import pytest

from sim.config.mission import AidsConfig
from sim.config.sensors import InstrumentsConfig
from sim.simulate.simulation import simulate
from survey import ConfigError, Dem, Grid, Leg, Route
from survey.data.recording import Recording

GRID = Grid((0.0, 0.0, 40.0, 40.0), 2.0)
FLAT = Dem.on(GRID, np.zeros(GRID.shape))
LINE = Route((Leg("swath", [[18.0, 20.0], [20.0, 20.0]]),), GRID.crs, "line")


def test_a_drive_in_images_is_returned_and_written(tmp_path):
    instruments = InstrumentsConfig(frame_rate_hz=2.0)
    recording, truth = simulate(
        FLAT, LINE, fidelity="vision", instruments=instruments, folder=tmp_path / "drive"
    )
    assert recording.camera is not None
    assert len(recording.frames) > 4
    assert truth.trajectory.length_m == pytest.approx(2.0, abs=0.6)
    stored = Recording.read(tmp_path / "drive" / "recording")
    assert len(stored.frames) == len(recording.frames)
    assert (tmp_path / "drive" / "drive.json").exists()


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"fidelity": "vision"}, "give a folder for them, such as folder='drive'"),
        (
            {"fidelity": "vision", "folder": "d", "aids": AidsConfig()},
            "'vision' does not use aids; leave it out",
        ),
        ({"folder": "d"}, "'statistical' does not use folder; leave it out, or choose another fidelity"),
        ({"fidelity": "ideal", "instruments": InstrumentsConfig()}, "'ideal' does not use instruments"),
    ],
)
def test_arguments_of_another_fidelity_are_refused(arguments, message):
    with pytest.raises(ConfigError, match=message):
        simulate(FLAT, LINE, **arguments)
