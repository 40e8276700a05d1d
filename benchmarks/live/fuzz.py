"""Malformed telemetry: damaged packets, and sound packets with damaged numbers."""

import os
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from pyproj import CRS

from benchmarks.report import Row
from live.watch.samples import Sample, SampleGate, TelemetryReader
from survey.core.arrays import FloatArray
from survey.core.streams import stream
from survey.core.transformation import transformed
from survey.io.vector import WGS84

SEED = 20_292
_CRS = CRS("EPSG:32608")
_ORIGIN = np.array([526_000.0, 6_478_000.0])
_BOUNDS = (525_800.0, 6_477_800.0, 526_600.0, 6_478_600.0)
_HEIGHT_M, _SIGMA_M = 900.0, 0.03
# A sample this far from the rover is wrong, whatever deviation it states.
_WRONG_M = 10.0
_FIELDS = ("lat", "lon", "alt", "v_acc", "time_usec", "fix_type")


@dataclass
class Counts:
    """What became of the packets."""

    packets: int = 0
    crashes: int = 0
    taken: int = 0
    wrong: int = 0
    genuine: int = 0


class Station(NamedTuple):
    """Receiving end: the parser of packets, the reader of messages, the gate of samples."""

    parser: Any
    reader: TelemetryReader
    gate: SampleGate


def fuzz_rows(quick: bool) -> Iterator[Row]:
    """Yield crashes and wrong fixes taken over many malformed packets."""
    counts = fuzzed(2_000 if quick else 100_000)
    name = f"{counts.packets} malformed packets"
    yield Row.of(f"{name}: crashes", counts.crashes, "1", "<=", 0)
    yield Row.of(f"{name}: wrong fixes taken", counts.wrong, "1", "<=", 0)
    yield Row.of(
        f"{name}: share of sound fixes between them that were taken",
        counts.taken / counts.genuine,
        "1",
        ">=",
        0.5,
    )


def fuzzed(n_packets: int) -> Counts:
    """Send malformed packets between the sound fixes of a rover that drives; count what is taken."""
    os.environ.setdefault("MAVLINK20", "1")
    from pymavlink.dialects.v20 import common

    rng, counts = stream(SEED, "packets"), Counts()
    sender, parser = common.MAVLink(None, 1, 1), common.MAVLink(None)
    parser.robust_parsing = True
    station = Station(parser, TelemetryReader(_CRS), SampleGate(_BOUNDS))
    while counts.packets < n_packets:
        second = counts.genuine
        place = _ORIGIN + [200.0 * np.sin(second / 300.0), 200.0 * np.cos(second / 300.0)]
        fix = _fix(common, place, second, rng)
        counts.genuine += 1
        counts.taken += _taken(station, fix.pack(sender), place, counts)
        for _ in range(5):
            counts.packets += 1
            _taken(station, _malformed(common, sender, place, second, rng), place, counts)
    return counts


def _fix(common: Any, place: FloatArray, second: int, rng: np.random.Generator) -> Any:
    """Return a sound fix at a place."""
    ((longitude, latitude),) = transformed(place[None], _CRS, WGS84, "the rover")
    height_mm = round(1000.0 * (_HEIGHT_M + _SIGMA_M * rng.standard_normal()))
    return common.MAVLink_gps_raw_int_message(
        1_000_000 * second, 6, round(1e7 * latitude), round(1e7 * longitude), height_mm, 60, 60, 100, 0, 20,
        height_mm, 20, round(1000.0 * _SIGMA_M), 50, 0,
    )  # fmt: skip


def _malformed(common: Any, sender: Any, place: FloatArray, second: int, rng: np.random.Generator) -> bytes:
    """Return a packet with flipped bits, a truncated one, noise, or a sound packet with a damaged number."""
    fix = _fix(common, place, second, rng)
    kind = rng.integers(4)
    if kind == 3:
        name = _FIELDS[rng.integers(len(_FIELDS))]
        limits = {
            "lat": 1 << 31,
            "lon": 1 << 31,
            "alt": 1 << 31,
            "v_acc": 1 << 32,
            "time_usec": 1 << 63,
            "fix_type": 256,
        }
        value = int(rng.integers(limits[name], dtype=np.uint64))
        setattr(fix, name, value - (1 << 30) if name in ("lat", "lon", "alt") else value)
        return bytes(fix.pack(sender))
    data = bytearray(fix.pack(sender))
    if kind == 0:
        for _ in range(int(rng.integers(1, 12))):
            data[rng.integers(len(data))] ^= 1 << int(rng.integers(8))
        return bytes(data)
    return bytes(data[: rng.integers(1, len(data))]) if kind == 1 else rng.bytes(int(rng.integers(1, 300)))


def _taken(station: "Station", data: bytes, place: FloatArray, counts: Counts) -> bool:
    """Give bytes to the parser and its samples to the gate; return whether one was taken."""
    try:
        messages = station.parser.parse_buffer(data) or []
        samples = [
            sample for message in messages if (sample := station.reader.sample_of(message)) is not None
        ]
        taken = [sample for sample in samples if station.gate.reason(sample) is None]
    except Exception:  # a crash of any kind is what is counted
        counts.crashes += 1
        return False
    counts.wrong += sum(_is_wrong(sample, place) for sample in taken)
    return bool(taken)


def _is_wrong(sample: Sample, place: FloatArray) -> bool:
    off_m = np.hypot(sample.x_m - place[0], sample.y_m - place[1])
    return bool(off_m > _WRONG_M or abs(sample.z_m - _HEIGHT_M) > max(_WRONG_M, 6.0 * sample.sigma_m))
