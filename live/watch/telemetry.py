"""Samples from the telemetry of a vehicle: fixes of its receiver, less the height of the antenna."""

from collections.abc import Generator, Iterator
from queue import SimpleQueue
from threading import Event, Thread
from time import monotonic
from typing import Any

import numpy as np
from pyproj import CRS

from live.link.vehicle import Vehicle
from live.watch.sample import Sample
from survey.core.transformation import transformed
from survey.io.vector import WGS84

_TYPES = ("GPS_RAW_INT", "SYS_STATUS", "BATTERY_STATUS")
_LEAST_FIX = 3
_UNKNOWN_PERCENT = -1
_PER_DEGREE, _MM = 1e7, 1000.0
_SILENCE_S = 5.0


class TelemetryReader:
    """Reader of messages of one vehicle.

    Parameters
    ----------
    crs : CRS
        Of the samples.
    antenna_m : float
        Height of the antenna above the ground [m].
    least_sigma_m : float
        Standard deviation that no sample falls below [m]; that of receivers which state none.

    Examples
    --------
    >>> from types import SimpleNamespace
    >>> reader = TelemetryReader(CRS("EPSG:32632"), antenna_m=1.0)
    >>> fix = SimpleNamespace(fix_type=6, lat=460000000, lon=90000000, alt=501000, h_acc=20, v_acc=30,
    ...                       time_usec=2000000, get_type=lambda: "GPS_RAW_INT")
    >>> sample = reader.sample_of(fix)
    >>> round(sample.x_m), sample.z_m, sample.sigma_m, sample.time_s
    (500000, 500.0, 0.03, 2.0)
    """

    def __init__(self, crs: CRS, antenna_m: float = 0.0, least_sigma_m: float = 0.01) -> None:
        self.crs, self.antenna_m, self.least_sigma_m = crs, antenna_m, least_sigma_m
        self.battery: float | None = None

    def sample_of(self, message: Any) -> Sample | None:
        """Return the sample that a message holds; None for other messages and for fixes of less than three dimensions.

        Parameters
        ----------
        message : object
            Of pymavlink.

        Returns
        -------
        Sample or None
            In the CRS.
        """
        kind = message.get_type()
        if kind in ("SYS_STATUS", "BATTERY_STATUS"):
            if _UNKNOWN_PERCENT < message.battery_remaining <= 100:
                self.battery = message.battery_remaining / 100.0
            return None
        if kind != "GPS_RAW_INT" or message.fix_type < _LEAST_FIX:
            return None
        longitude, latitude = message.lon / _PER_DEGREE, message.lat / _PER_DEGREE
        if not (abs(latitude) <= 90.0 and abs(longitude) <= 180.0):
            return None
        x, y = transformed(np.array([[longitude, latitude]]), WGS84, self.crs, "the fix")[0].tolist()
        sigma = max(message.v_acc / _MM, self.least_sigma_m)
        height = message.alt / _MM - self.antenna_m
        return Sample(message.time_usec / 1e6, x, y, height, sigma, self.battery)


def telemetry_entries(vehicle: Vehicle, reader: TelemetryReader) -> Iterator[dict[str, Any]]:
    """Yield the inputs of a watch as they arrive, silences included; without end.

    Parameters
    ----------
    vehicle : Vehicle
        That sends telemetry.
    reader : TelemetryReader
        Of its messages.

    Yields
    ------
    dict
        Samples and silences.
    """
    last_s, heard = 0.0, monotonic()
    while True:
        message = vehicle.receive(_TYPES, _SILENCE_S)
        if message is None:
            yield {"in": "silence", "time_s": round(last_s + monotonic() - heard, 1)}
            continue
        sample = reader.sample_of(message)
        heard = monotonic()
        if sample is not None:
            last_s = sample.time_s
            yield {"in": "sample", "sample": list(sample)}


def buffered_entries(vehicle: Vehicle, reader: TelemetryReader) -> Generator[dict[str, Any], None, None]:
    """Yield what `telemetry_entries` does, received by a thread, so that nothing is lost while an advice is computed.

    Parameters
    ----------
    vehicle : Vehicle
        That sends telemetry; its connection stays open until the generator is closed.
    reader : TelemetryReader
        Of its messages.

    Yields
    ------
    dict
        Samples and silences.
    """
    arrived: SimpleQueue[dict[str, Any] | Exception] = SimpleQueue()
    over = Event()
    thread = Thread(target=_receive, args=(vehicle, reader, arrived, over), daemon=True)
    thread.start()
    try:
        while True:
            entry = arrived.get()
            if isinstance(entry, Exception):
                raise entry
            yield entry
    finally:
        over.set()
        thread.join()


def _receive(
    vehicle: Vehicle,
    reader: TelemetryReader,
    arrived: "SimpleQueue[dict[str, Any] | Exception]",
    over: Event,
) -> None:
    """Put what arrives into a queue; an error as well, which ends it."""
    try:
        for entry in telemetry_entries(vehicle, reader):
            if over.is_set():
                return
            arrived.put(entry)
    except Exception as error:  # raised again where the entries are taken
        arrived.put(error)
