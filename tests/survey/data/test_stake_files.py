import numpy as np
import pytest

from survey import InputError
from survey.data.sensors.stakes import read_stake_surveys

TABLE = """point,time,x,y,z
north,2026-07-01T09:30:00Z,500010.0,6000020.0,812.0
south,2026-07-01T09:40:00Z,500015.0,5999020.0,790.0
north,2026-07-02T11:30:00+02:00,500011.5,6000020.2,811.9
"""


def test_dates_become_seconds_and_names_indices(tmp_path):
    (tmp_path / "stakes.csv").write_text(TABLE)
    names, surveys = read_stake_surveys(tmp_path / "stakes.csv", zero=1782898200.0)
    assert names == ("north", "south")
    assert surveys.index.tolist() == [0, 1, 0]
    # A day later; 11:30 at an offset of two hours is 9:30 UTC.
    np.testing.assert_allclose(surveys.time_s, [0.0, 600.0, 86400.0])
    np.testing.assert_allclose(surveys.sigma_m, 0.03)


def test_seconds_and_stated_errors_are_read(tmp_path):
    (tmp_path / "s.csv").write_text("point,time,x,y,z,sigma\n1,50,0,0,0,0.1\n1,20,1,0,0,0.2\n")
    surveys = read_stake_surveys(tmp_path / "s.csv").surveys
    assert surveys.time_s.tolist() == [20.0, 50.0]
    assert surveys.sigma_m.tolist() == [0.2, 0.1]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("point,time,x,y\n1,2,3,4\n", "has no column of heights"),
        ("time,x,y,z\n1,2,3,4\n", "has no column of points"),
        ("point,x,y,z\n1,2,3,4\n", "has no column of times"),
        ("point,time,lon,lat,z\n1,5,7,46,3\n", "places in degrees"),
        ("point,time,x,y,z\n1,noon,0,0,0\n", "line 2: 'noon' is no time"),
        ("point,time,x,y,z\n1,5,east,0,0\n", "line 2: 'east' in the column x is no number"),
        ("point,time,x,y,z\n1,5,nan,0,0\n", "line 2: the column x holds no finite number"),
        ("point,time,x,y,z\n", "a header and no rows"),
    ],
)
def test_tables_that_cannot_be_read_are_refused(tmp_path, text, message):
    (tmp_path / "s.csv").write_text(text)
    with pytest.raises(InputError, match=message):
        read_stake_surveys(tmp_path / "s.csv")


@pytest.mark.parametrize(
    ("times", "words"),
    [
        (("20240601", "20240611"), r"column time writes dates as one number \(20240601\)"),
        (("2024.4167", "2024.4440"), "counts years"),
        (("2024-06-01", "20240611"), "line 3: the times begin as dates and go on otherwise"),
        (("0", "2024-06-11"), "line 3: the times begin as numbers and go on otherwise"),
    ],
)
def test_dates_that_would_be_taken_for_seconds_are_refused(tmp_path, times, words):
    (tmp_path / "s.csv").write_text("point,time,x,y,z\n" + "".join(f"1,{t},0,0,0\n" for t in times))
    with pytest.raises(InputError, match=words):
        read_stake_surveys(tmp_path / "s.csv")


def test_blanks_around_a_name_make_no_other_stake(tmp_path):
    (tmp_path / "s.csv").write_text("point,time,x,y,z\nA,0,0,0,0\nA ,86400,1,0,0\n")
    assert read_stake_surveys(tmp_path / "s.csv").names == ("A",)


def test_tables_of_receivers_are_read(tmp_path, caplog):
    rows = "Stake A;2026-07-01;500010,5;6000020,0;812,25;8\nStake A;2026-07-11;500011,5;6000020,0;811,95;9\n"
    (tmp_path / "s.csv").write_text("Point ID;Date;Easting;Northing;Elevation;SDV (mm)\n" + rows)
    names, surveys = read_stake_surveys(tmp_path / "s.csv")
    assert names == ("Stake A",)
    assert np.diff(surveys.time_s).tolist() == [864000.0]
    assert surveys.position.tolist() == [[500010.5, 6000020.0, 812.25], [500011.5, 6000020.0, 811.95]]
    np.testing.assert_allclose(surveys.sigma_m, [0.008, 0.009])
    assert "time = Date" in caplog.text
