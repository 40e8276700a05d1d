"""Dates of NMEA sentences, and fixes of several systems of satellites at one time."""

import functools
import operator

import numpy as np
import pytest

from vision_slam.readers.gps_files import read_gps

DAY_S = 86400.0
UNIX = 1718064000.0  # 11 June 2024


def sentence(body):
    return f"${body}*{functools.reduce(operator.xor, body.encode()):02X}\n"


def gga(clock, minutes=0.0, system="GN", height="500.0", quality=1):
    return sentence(
        f"{system}GGA,{clock},460{minutes:.4f},N,00800.0000,E,{quality},12,0.5,{height},M,48.0,M,,"
    )


def rmc(clock, date):
    return sentence(f"GNRMC,{clock},A,4600.0000,N,00800.0000,E,0.0,0.0,{date},,,A")


def log_of(tmp_path, *sentences):
    (tmp_path / "log.nmea").write_text("".join(sentences))
    return read_gps(tmp_path / "log.nmea")


@pytest.mark.parametrize("is_date_first", [True, False])
def test_each_date_holds_for_its_own_day(tmp_path, is_date_first):
    days = [("110624", ("071502.00", "071503.00")), ("120624", ("101502.00", "101503.00"))]
    pairs = [(rmc(clock, date), gga(clock)) for date, clocks in days for clock in clocks]
    log = log_of(tmp_path, *(line for pair in pairs for line in (pair if is_date_first else pair[::-1])))
    assert (log.time_s - UNIX).tolist() == [26102.0, 26103.0, DAY_S + 36902.0, DAY_S + 36903.0]
    assert log.is_dated


def test_a_date_of_zda_holds_from_the_pause_before_it(tmp_path):
    zda = [sentence(f"GPZDA,{clock},{day},06,2024,00,00") for clock, day in (("200000", 11), ("100003", 12))]
    fixes = [gga(clock) for clock in ("200001.00", "200002.00", "100001.00", "100002.00", "100004.00")]
    log = log_of(tmp_path, zda[0], *fixes[:4], zda[1], sentence("GPZDA,100003,,,,00,00"), fixes[4])
    expected = [72001.0, 72002.0, DAY_S + 36001.0, DAY_S + 36002.0, DAY_S + 36004.0]
    assert (log.time_s - UNIX).tolist() == expected


def test_a_date_before_midnight_counts_over_it(tmp_path):
    log = log_of(tmp_path, rmc("235959.00", "110624"), gga("235959.00"), gga("000000.50"))
    assert (log.time_s - UNIX).tolist() == [DAY_S - 1.0, DAY_S + 0.5]


def test_of_fixes_of_one_time_that_of_all_systems_is_taken(tmp_path):
    lines = [gga(f"10000{k}.00", minutes, system) for k in range(3) for minutes, system in ((1.0, "GP"), (2.0, "GN"))]  # fmt: skip
    log = log_of(tmp_path, *lines, gga("100009.00", 3.0, "GN"), gga("100009.00", 1.0, "GL"))
    np.testing.assert_allclose(60.0 * (log.place[:, 1] - 46.0), [2.0, 2.0, 2.0, 3.0])
    assert log.notes == (
        "4 fixes by another system of satellites at the time of one that is taken are left out",
    )


def test_a_fix_without_a_height_is_left_out_and_counted(tmp_path):
    log = log_of(tmp_path, gga("100000.00"), gga("100001.00", height=""), gga("100002.00"))
    assert log.time_s.tolist() == [36000.0, 36002.0]
    assert log.n_without_fix == 1
