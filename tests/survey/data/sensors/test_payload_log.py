"""Logs of a measured quantity: readings that a logger marks as missing are refused."""

from pathlib import Path

import pytest

from survey.core.errors import InputError
from survey.data.sensors.payload import PayloadLog, Quantity

AIR = Quantity(name="air_temperature", unit="degC", noise_sd=0.1)


def log(path: Path, seventh: float) -> Path:
    values = [seventh if k == 7 else -4.0 + 0.1 * k for k in range(12)]
    rows = [f"{k}.0,{value}\n" for k, value in enumerate(values)]
    path.write_text("time_s,air_temperature\n" + "".join(rows))
    return path


@pytest.mark.parametrize("mark", [-999.0, -6999.0, -9999.0, -99999.0])
def test_marks_of_missing_readings_are_refused(tmp_path: Path, mark: float) -> None:
    with pytest.raises(InputError, match=rf"log\.csv holds {mark:g} in 1 rows, which stands for a missing"):
        PayloadLog.read(log(tmp_path / "log.csv", mark), AIR)


def test_a_low_reading_is_none(tmp_path: Path) -> None:
    assert PayloadLog.read(log(tmp_path / "log.csv", -40.0), AIR).value.min() == -40.0
