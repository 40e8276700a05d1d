"""Binary logs of u-blox receivers: the positions of UBX-NAV-PVT messages, or of NMEA sentences between the messages."""

import re
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np

from survey.core.crs.vertical_datum import ELLIPSOIDAL
from survey.core.errors import InputError
from vision_slam.io.receivers.nmea import read_nmea
from vision_slam.io.receivers.rows import ReceiverFixes

SYNC = b"\xb5\x62"
_GGA = re.compile(rb"\$G[A-Z]GGA,")
_POSITIONS = (2, 3, 4)  # 2D, 3D, with dead reckoning


def read_ublox(file: Path) -> ReceiverFixes:
    """Read the positions of a binary log; other messages in it (RTCM, raw data) are passed over.

    The horizontal accuracy estimate of the receiver, a standard deviation of the distance, is
    divided by √2 for each axis. Heights are ellipsoidal. Messages whose checksum is wrong, as a
    log that begins or ends in the middle of one has, are left out and counted, and so are positions that the
    receiver itself does not call valid (``gnssFixOK``). A log without NAV-PVT gives the fixes of its NMEA sentences,
    with a note.

    Parameters
    ----------
    file : Path
        The ``.ubx`` file.

    Returns
    -------
    ReceiverFixes
        Positions with date, time and standard deviation.

    Raises
    ------
    InputError
        No NAV-PVT message with a position and no GGA sentence.
    """
    from pyubx2 import ERR_LOG, UBX_PROTOCOL, UBXReader

    damaged: list[Exception] = []
    rows, n_without_fix = [], 0
    with file.open("rb") as stream:
        reader = UBXReader(stream, protfilter=UBX_PROTOCOL, quitonerror=ERR_LOG, errorhandler=damaged.append)
        for _, message in reader:
            if getattr(message, "identity", "") != "NAV-PVT":
                continue
            is_dated = message.validDate and message.validTime
            if message.fixType not in _POSITIONS or not (message.gnssFixOk and is_dated):
                n_without_fix += 1
                continue
            rows.append(_position(message))
    if not rows and n_without_fix == 0 and _GGA.search(file.read_bytes()):
        fixes = read_nmea(file)
        return fixes._replace(
            notes=("no NAV-PVT message: the fixes are those of NMEA sentences", *fixes.notes)
        )
    if not rows:
        raise InputError(
            f"{file} holds no NAV-PVT message with a position ({n_without_fix} without one, {len(damaged)} damaged); "
            "switch UBX-NAV-PVT on in the receiver, and wait for a fix."
        )
    table = np.array(rows)
    notes = (f"{len(damaged)} damaged messages of the receiver are left out",) if damaged else ()
    return ReceiverFixes(
        table[:, 0],
        table[:, 1:4],
        table[:, 4],
        n_without_fix=n_without_fix,
        vertical_datum=ELLIPSOIDAL,
        notes=notes,
    )


def _position(message: Any) -> tuple[float, float, float, float, float]:
    """Return Unix time [s], longitude, latitude [deg], ellipsoidal height and standard deviation [m]."""
    day = datetime(message.year, message.month, message.day, tzinfo=UTC).timestamp()
    clock = 3600.0 * message.hour + 60.0 * message.min + message.second + 1e-9 * message.nano
    sigma_m = 1e-3 * message.hAcc / float(np.sqrt(2.0))
    return day + clock, message.lon, message.lat, 1e-3 * message.height, sigma_m
