"""Logs of phones and receivers, and tables of other programs, as `read_gps` reads them."""

import functools
import operator
import struct

import numpy as np
import pytest

from survey.core.errors import ConfigError, InputError
from vision_slam.readers.gps_files import read_gps
from vision_slam.recordings import open_recording

HEADER = "# Fix,Provider,LatitudeDegrees,LongitudeDegrees,AltitudeMeters,SpeedMps,AccuracyMeters,BearingDegrees,UnixTimeMillis"
UNIX = 1718186400


def test_gnss_logger_gives_the_fixes_of_the_satellites(tmp_path):
    log = tmp_path / "gnss_log.txt"
    lines = ["# Version: v3.0", HEADER, "Raw,1,2,3"]
    lines += [f"Fix,NLP,46.5,8.5,400.0,,44.0,,{UNIX}000", f"Fix,GPS,46.0,8.0,500.0,,3.02,,{UNIX}000"]
    lines += [
        f"Fix,GPS,46.0,8.0,500.0,,3.02,,{UNIX}000",
        f"Fix,GPS,46.0001,8.0,501.0,0.1,6.04,,{UNIX + 1}500",
    ]
    log.write_text("\n".join(lines))
    fixes = read_gps(log)
    np.testing.assert_allclose(fixes.time_s, [UNIX, UNIX + 1.5])
    np.testing.assert_allclose(fixes.place, [[8.0, 46.0, 500.0], [8.0, 46.0001, 501.0]])
    np.testing.assert_allclose(fixes.sigma_m, [2.0, 4.0])
    assert fixes.is_dated
    assert fixes.vertical_datum == "ellipsoidal height"
    assert fixes.notes == ("fixes of the provider GPS (1 of NLP are left out)",)


def test_fixes_without_an_altitude_are_left_out_and_counted(tmp_path):
    lines = [f"Fix,GPS,46.0,8.0,{height},,3.0,,{UNIX + k}000" for k, height in enumerate(("", 500.0, 501.0))]
    (tmp_path / "log.txt").write_text("\n".join([HEADER, *lines]))
    log = read_gps(tmp_path / "log.txt")
    assert log.place[:, 2].tolist() == [500.0, 501.0]
    assert log.n_without_fix == 1


@pytest.mark.parametrize(
    ("line", "words"),
    [
        (f"Fix,GPS,46.0,8.0,-29co.1,,3.0,,{UNIX}000", "line 2 is no fix with time"),
        (f"Fix,GPS,146.0,8.0,1.0,,3.0,,{UNIX}000", "are no degrees"),
        ("Fix,GPS,46.0", "line 2 is no fix"),
        (f"Fix,GPS,46.0,8.0,1.0,,3.0,,{UNIX}000", "holds 1 fixes and no two of one provider"),
    ],
)
def test_a_damaged_gnss_log_is_refused_in_one_sentence(tmp_path, line, words):
    (tmp_path / "log.txt").write_text(f"{HEADER}\n{line}\n")
    with pytest.raises(InputError, match=words):
        read_gps(tmp_path / "log.txt")


def nav_pvt(second, latitude, fix_type=3, valid=7, flags=1):
    """Return a UBX-NAV-PVT message."""
    payload = struct.pack(
        "<IHBBBBBBIiBBBBiiiiIIiiiiiIIHHI2xihH",
        *(second * 1000, 2024, 6, 12, 10, 0, second, valid, 10, 500_000_000, fix_type, flags, 0, 12),
        *(80_000_000, round(latitude * 1e7), 548_000, 500_000, 20, 30, 0, 0, 0, 0, 0, 10, 10, 100),
        *(0, 0, 0, 0, 0),
    )
    body = struct.pack("<BBH", 1, 7, 92) + payload.ljust(92, b"\0")[:92]
    a = b = 0
    for byte in body:
        a = (a + byte) & 0xFF
        b = (b + a) & 0xFF
    return b"\xb5\x62" + body + bytes((a, b))


@pytest.mark.parametrize("name", ["log.ubx", "COM3.bin"])
def test_ublox_gives_positions_with_their_accuracy(tmp_path, name):
    log = tmp_path / name
    cut = nav_pvt(3, 46.0)[:50]
    log.write_bytes(
        nav_pvt(0, 45.0, fix_type=0) + nav_pvt(1, 46.0) + b"$GNTXT,noise\r\n" + nav_pvt(2, 46.0001) + cut
    )
    fixes = read_gps(log)
    np.testing.assert_allclose(fixes.time_s, [UNIX + 1.5, UNIX + 2.5])
    np.testing.assert_allclose(fixes.place[:, :2], [[8.0, 46.0], [8.0, 46.0001]])
    np.testing.assert_allclose(fixes.place[:, 2], 548.0)
    np.testing.assert_allclose(fixes.sigma_m, 0.02 / np.sqrt(2.0))
    assert fixes.n_without_fix == 1


def test_positions_that_the_receiver_does_not_call_valid_are_left_out(tmp_path):
    (tmp_path / "a.ubx").write_bytes(
        nav_pvt(1, 46.0) + nav_pvt(2, 47.0, flags=0) + nav_pvt(3, 46.1) + nav_pvt(4, 46.2)
    )
    fixes = read_gps(tmp_path / "a.ubx")
    assert fixes.place[:, 1].tolist() == pytest.approx([46.0, 46.1, 46.2])
    assert fixes.n_without_fix == 1


def test_a_ublox_log_without_positions_gives_those_of_its_sentences(tmp_path):
    raw = nav_pvt(1, 46.0)[:2] + b"\x02\x15$$"  # the head of a message of raw data
    body = [
        b"GNGGA,10000%d.00,4600.%04d,N,00800.0000,E,4,12,0.5,500.0,M,48.0,M,1.0,0" % (k, k) for k in range(3)
    ]
    sums = [b"*%02X" % functools.reduce(operator.xor, sentence) for sentence in body]
    sentences = [b"$" + sentence + end + b"\r\n" for sentence, end in zip(body, sums, strict=True)]
    (tmp_path / "f9p.ubx").write_bytes(b"".join(raw + sentence for sentence in sentences))
    fixes = read_gps(tmp_path / "f9p.ubx")
    assert len(fixes.time_s) == 3
    assert fixes.place[0].tolist() == pytest.approx([8.0, 46.0, 500.0])
    assert fixes.notes[0] == "no NAV-PVT message: the fixes are those of NMEA sentences"


def test_a_fix_without_a_hemisphere_is_refused(tmp_path):
    body = b"GNGGA,100001.00,4600.0000,,00800.0000,E,4,12,0.5,500.0,M,48.0,M,1.0,0"
    (tmp_path / "log.nmea").write_bytes(b"$" + body + b"*%02X\r\n" % functools.reduce(operator.xor, body))
    with pytest.raises(InputError, match=r"line 1: the hemisphere '' is neither N nor S in a GGA sentence"):
        read_gps(tmp_path / "log.nmea")


def test_damaged_messages_are_counted_and_a_log_without_positions_is_refused(tmp_path):
    broken = bytearray(nav_pvt(2, 46.0))
    broken[20] ^= 1
    (tmp_path / "a.ubx").write_bytes(nav_pvt(1, 46.0) + bytes(broken) + nav_pvt(3, 46.1))
    fixes = read_gps(tmp_path / "a.ubx")
    assert len(fixes.time_s) == 2
    assert fixes.notes == ("1 damaged messages of the receiver are left out",)
    (tmp_path / "b.ubx").write_bytes(bytes(broken))
    with pytest.raises(InputError, match=r"no NAV-PVT message with a position \(0 without one, 1 damaged\)"):
        read_gps(tmp_path / "b.ubx")
    (tmp_path / "c.ubx").write_bytes(b"")
    with pytest.raises(InputError, match=r"c\.ubx"):
        read_gps(tmp_path / "c.ubx")


@pytest.mark.parametrize(
    ("header", "first", "second"),
    [
        ("time,lat,lon,alt", f"{UNIX},46,8,500", f"{UNIX + 1},46.1,8,500"),
        ("timestamp;Latitude;Longitude;Height", f"{UNIX};46,0;8,0;500,0", f"{UNIX + 1};46,1;8,0;500,0"),
        ("UTC,Lat,lng,ele", "2024-06-12T10:00:00Z,46,8,500", "2024-06-12T12:00:01+02:00,46.1,8,500"),
        ("datetime,latitude,longitude,altitude", "2024/06/12 10:00:00,46,8,500", "2024-06-12 10:00:01,46.1,8,500"),
        ("unix_ms,lat,long,elevation", f"{UNIX}000,46,8,500", f"{UNIX + 1}000,46.1,8,500"),
        ("UnixTimeMillis,LatitudeDegrees,LongitudeDegrees,AltitudeMeters", f"{UNIX}000,46,8,500", f"{UNIX + 1}000,46.1,8,500"),
    ],
)  # fmt: skip
def test_usual_columns_are_read_and_said(tmp_path, header, first, second):
    (tmp_path / "fixes.csv").write_text(f"{header}\n{first}\n{second}\n")
    fixes = read_gps(tmp_path / "fixes.csv")
    np.testing.assert_allclose(fixes.time_s, [UNIX, UNIX + 1])
    np.testing.assert_allclose(fixes.place, [[8.0, 46.0, 500.0], [8.0, 46.1, 500.0]])
    assert fixes.is_dated
    assert "columns read as time = " in fixes.notes[0]


@pytest.mark.parametrize(
    ("name", "stated", "sigma"),
    [
        ("hacc", 3.02, 2.0),
        ("h_acc", 3.02, 2.0),
        ("accuracy", 3.02, 2.0),
        ("sdh", 2.0, np.sqrt(2.0)),
        ("SDH (mm)", 20.0, 0.02 / np.sqrt(2.0)),
    ],
)
def test_the_error_of_each_fix_is_read_by_what_its_name_says(tmp_path, name, stated, sigma):
    (tmp_path / "fixes.csv").write_text(
        f"time,lat,lon,alt,{name}\n0,46,8,500,{stated}\n1,46,8,500,{stated}\n"
    )
    np.testing.assert_allclose(read_gps(tmp_path / "fixes.csv").sigma_m, sigma)


def test_a_mapping_names_columns_of_metres(tmp_path):
    (tmp_path / "fixes.txt").write_text(
        "t,Rechts,Hoch,H2,m\n0,500000,5100000,500,0.02\n1,500001,5100000,500,0.02\n"
    )
    fixes = read_gps(tmp_path / "fixes.txt", ["time=t,x=Rechts", "y=Hoch,z=H2,sigma_xy=m"])
    assert not fixes.is_geodetic
    np.testing.assert_allclose(fixes.place[:, 0], [500000.0, 500001.0])
    np.testing.assert_allclose(fixes.sigma_m, 0.02 / np.sqrt(2.0))
    assert "time = t, height = H2, sigma_xy = m, easting = Rechts, northing = Hoch" in fixes.notes[0]
    with pytest.raises(
        InputError, match=r"no column of northing and height .* name it with --columns y=NAME"
    ):
        read_gps(tmp_path / "fixes.txt", ["time=t,x=Rechts"])


@pytest.mark.parametrize(
    ("content", "words"),
    [
        ("time,lat,alt\n0,46,500\n", "no column of longitude .* name it with --columns lon=NAME"),
        ("time,lat,lon,alt\n0,46,8,500\n1,north,8,500\n", "line 3: 'north' in the column lat is no angle"),
        ("time,lat,lon,alt\n2024-99-01,46,8,500\n1,46,8,500\n", "is no number and no date such as"),
        ("time,lat,lon,alt\n0,5100000,8,500\n1,5100000,8,500\n", "are no degrees"),
        ("time,lat,lon,alt\n0,nan,nan,500\n1,5100000,8,500\n", "are no degrees"),
        ("time,lat,lon,alt,hacc\n0,46,8,500,0\n1,46,8,500,1\n", "an error that is not above 0"),
        ("time,lat,lon,alt\n", "no rows"),
    ],
)
def test_a_damaged_table_is_refused_in_one_sentence(tmp_path, content, words):
    (tmp_path / "fixes.csv").write_text(content)
    with pytest.raises(InputError, match=words):
        read_gps(tmp_path / "fixes.csv")


def test_positions_of_rtklib_are_recognized_by_their_content(tmp_path):
    line = "2015/07/07 16:0{}:20.000   77.679932054  -68.607229038    59.4639   1   9   0.0003   0.0002   0.0010   0.0001   0.0001   0.0004   0.00   24.3"
    (tmp_path / "stake.dat").write_text("\n".join(line.format(k) for k in (3, 4)) + "\n")
    np.testing.assert_allclose(read_gps(tmp_path / "stake.dat").sigma_m, 0.01)


def test_raw_observations_are_refused_with_the_next_step(tmp_path):
    (tmp_path / "phone.23o").write_text(
        "     3.03           OBSERVATION DATA    M                   RINEX VERSION / TYPE\n"
    )
    with pytest.raises(InputError, match="process them with RTKLIB"):
        read_gps(tmp_path / "phone.23o")


def test_columns_without_a_table_are_refused(tmp_path):
    (tmp_path / "a.gpx").write_text("<gpx/>")
    with pytest.raises(ConfigError, match="is no table; leave --columns out"):
        read_gps(tmp_path / "a.gpx", ["time=t"])
    with pytest.raises(ConfigError, match="name the table with --gps"):
        open_recording(tmp_path, columns=["time=t"])


@pytest.mark.parametrize(
    "table",
    [
        "Date,Time,Latitude,Longitude,Altitude\n2024-06-12,10:00:00,46.0,8.0,500.0\n2024-06-12,10:00:01.5,46.0001,8.0,501.0\n",
        "Datum;Uhrzeit;Breite;Länge;Höhe\n12.06.2024;10:00:00;46,0;8,0;500,0\n12.06.2024;10:00:01.5;46,0001;8,0;501,0\n",
        "zeit;lat;lon;alt\n12.06.2024 10:00:00;46,0;8,0;500\n12.06.2024 10:00:01.5;46,0001;8,0;501\n",
    ],
)
def test_days_and_times_of_day_are_read_from_one_column_or_two(tmp_path, table):
    (tmp_path / "fixes.csv").write_text(table)
    log = read_gps(tmp_path / "fixes.csv")
    np.testing.assert_allclose(log.time_s, [UNIX, UNIX + 1.5])
    np.testing.assert_allclose(log.place, [[8.0, 46.0, 500.0], [8.0, 46.0001, 501.0]])


def test_seconds_with_decimal_commas_are_numbers(tmp_path):
    (tmp_path / "phyphox.csv").write_text(
        '"Time (s)";"Latitude (°)";"Longitude (°)";"Height (m)";"Horizontal Accuracy (m)"\n'
        "0,12;46,0;8,0;500,0;3,02\n1,12;46,0001;8,0;501,0;3,02\n"
    )
    log = read_gps(tmp_path / "phyphox.csv")
    np.testing.assert_allclose(log.time_s, [0.12, 1.12])
    np.testing.assert_allclose(log.sigma_m, [2.0, 2.0])
    assert not log.is_dated


def test_fixes_beyond_84_degrees_are_in_polar_stereographic(tmp_path):
    (tmp_path / "north.csv").write_text(
        "time_s,latitude_deg,longitude_deg,height_m\n0,85,-40,1\n1,85.0001,-40,1\n"
    )
    assert read_gps(tmp_path / "north.csv").fixes()[1].to_epsg() == 3413


@pytest.mark.parametrize(
    ("table", "words"),
    [
        ("time,lat,lon,alt\n20240612100015,46,8,5\n20240612100016,46,8,5\n", "dates as one number"),
        (
            "time,lat,lon,alt\n100058,46,8,5\n100059,46,8,5\n100100,46,8,5\n",
            "hours, minutes and seconds in one",
        ),
        ("time,lat,N/S,lon,alt\n0,46,S,8,5\n1,46,S,8,5\n", "states S in the column N/S"),
    ],
)
def test_times_and_degrees_that_would_be_taken_for_others_are_refused(tmp_path, table, words):
    (tmp_path / "fixes.csv").write_text(table)
    with pytest.raises(InputError, match=words):
        read_gps(tmp_path / "fixes.csv")


def test_seconds_that_could_be_a_clock_remain_seconds(tmp_path):
    rows = "".join(f"{t},46,8,5\n" for t in range(100000, 101000, 100))
    (tmp_path / "fixes.csv").write_text("time,lat,lon,alt\n" + rows)
    assert np.ptp(read_gps(tmp_path / "fixes.csv").time_s) == 900.0


def _rmc_gga(second, latitude, longitude):
    body = f"GPGGA,0000{second:02d}.00,{latitude},N,{longitude},E,1,8,1.0,500.0,M,0.0,M,,"
    return f"${body}*{functools.reduce(operator.xor, body.encode()):02X}"


ZERO_FIRST = {
    "own.csv": "time_s,latitude_deg,longitude_deg,height_m,sigma_m\n0,0,0,0,9\n1,46,8,500,1\n2,46.1,8,500,1\n",
    "other.csv": "t,lat,lon,alt\n0,0,0,0\n1,46,8,500\n2,46.1,8,500\n",
    "log.nmea": "\n".join(
        [_rmc_gga(0, "0000.0", "00000.0"), _rmc_gga(1, "4600.0", "00800.0"), _rmc_gga(2, "4606.0", "00800.0")]
    ),
    "rover.pos": "\n".join(
        f"2024/05/01 12:00:0{k}.0 {latitude} {longitude} 500.0 5 9 1 1 1 0 0 0 0 0"
        for k, (latitude, longitude) in enumerate([(0.0, 0.0), (46.0, 8.0), (46.1, 8.0)])
    ),
    "track.gpx": '<gpx version="1.1" creator="x" xmlns="http://www.topografix.com/GPX/1/1"><trk><trkseg>'
    + "".join(
        f'<trkpt lat="{latitude}" lon="{longitude}"><ele>500</ele><time>2024-05-01T12:00:0{k}Z</time></trkpt>'
        for k, (latitude, longitude) in enumerate([(0.0, 0.0), (46.0, 8.0), (46.1, 8.0)])
    )
    + "</trkseg></trk></gpx>",
}


@pytest.mark.parametrize("name", list(ZERO_FIRST))
def test_fixes_at_longitude_and_latitude_zero_are_left_out_and_counted(tmp_path, name):
    (tmp_path / name).write_text(ZERO_FIRST[name])
    log = read_gps(tmp_path / name)
    np.testing.assert_allclose(log.place[:, :2], [[8.0, 46.0], [8.0, 46.1]], atol=1e-6)
    assert len(log.time_s) == 2
    assert log.sigma_m is None or len(log.sigma_m) == 2
    assert log.notes[-1] == "1 fixes at longitude and latitude 0 are left out"
    assert log.utm.to_epsg() == 32632


def test_a_log_of_zeros_alone_is_refused_and_metres_may_be_zero(tmp_path):
    file = tmp_path / "log.csv"
    file.write_text("time_s,latitude_deg,longitude_deg,height_m\n0,0,0,0\n1,0,0,0\n")
    with pytest.raises(InputError, match="2 fixes, all at longitude and latitude 0"):
        read_gps(file)
    file.write_text("time_s,easting_m,northing_m,height_m\n0,0,0,0\n1,1,0,0\n")
    assert len(read_gps(file).time_s) == 2


def test_a_first_fix_far_from_the_others_does_not_choose_the_zone(tmp_path):
    file = tmp_path / "log.csv"
    rows = ["0,10,20,0", "1,46,179.99,500", "2,46,-179.99,500", "3,46,-179.98,500"]
    file.write_text("\n".join(["time_s,latitude_deg,longitude_deg,height_m", *rows, ""]))
    assert read_gps(file).utm.to_epsg() == 32660
    file.write_text("\n".join(["time_s,latitude_deg,longitude_deg,height_m", *rows[2:], ""]))
    assert read_gps(file).utm.to_epsg() == 32601


def test_a_column_of_gps_times_is_noted(tmp_path):
    rows = "".join(f"{1718187302.0 + k},58.4,-134.6,{5.0 + k}\n" for k in range(3))
    for name, n_notes in (("gps_time", 2), ("timestamp", 1)):
        (tmp_path / "fixes.csv").write_text(f"{name},latitude,longitude,altitude\n{rows}")
        assert len(read_gps(tmp_path / "fixes.csv").notes) == n_notes
