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


def test_logs_with_semicolons_and_decimal_commas_are_read(tmp_path: Path) -> None:
    rows = "".join(f"{k},0;{-4 - k},5;ok\n" for k in range(12))
    (tmp_path / "log.csv").write_text("time_s;air_temperature;flag\n" + rows)
    found = PayloadLog.read(tmp_path / "log.csv", AIR)
    assert found.value[:2].tolist() == [-4.5, -5.5]
    assert found.time_s is not None
    other = Quantity(name="albedo", unit="1", noise_sd=0.1)
    with pytest.raises(InputError, match=r"has no column albedo \(found time_s, air_temperature, flag\)"):
        PayloadLog.read(tmp_path / "log.csv", other)
