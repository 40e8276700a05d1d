"""Addresses of MAVLink connections."""

from dataclasses import dataclass
from urllib.parse import urlsplit

from survey.core.errors import InputError

_EXPECTED = (
    "udp://HOST:PORT (sends to a vehicle), udpin://HOST:PORT (waits for one that sends to this port), "
    "tcp://HOST:PORT or serial:///dev/DEVICE:BAUD"
)
_OPENERS = {"udp": "udpout", "udpout": "udpout", "udpin": "udpin", "tcp": "tcp"}
_MOST_PORT = 65535


@dataclass(frozen=True)
class LinkAddress:
    """Address of a MAVLink connection.

    Parameters
    ----------
    text : str
        As the user wrote it.
    device : str
        Device in the notation of pymavlink.
    baud : int
        Bits per second of a serial line.
    """

    text: str
    device: str
    baud: int = 57600

    @classmethod
    def parsed(cls, text: str) -> "LinkAddress":
        """Read an address.

        Parameters
        ----------
        text : str
            ``udp://HOST:PORT``, ``udpin://HOST:PORT``, ``tcp://HOST:PORT`` or ``serial:///dev/DEVICE:BAUD``.

        Returns
        -------
        LinkAddress
            For `live.link.vehicle.Vehicle.connected`.

        Raises
        ------
        InputError
            Another scheme, or no host or port.

        Examples
        --------
        >>> LinkAddress.parsed("udp://127.0.0.1:14550").device
        'udpout:127.0.0.1:14550'
        >>> LinkAddress.parsed("serial:///dev/ttyUSB0:115200").baud
        115200
        """
        scheme, _, rest = text.partition("://")
        if scheme == "serial" and rest:
            device, _, baud = rest.rpartition(":")
            if not baud.isdigit():
                device, baud = rest, "57600"
            return cls(text, device, int(baud))
        host, port = _host_and_port(text)
        if scheme not in _OPENERS or port is None:
            raise InputError(f"the address {text} is no MAVLink connection; {_EXPECTED} was expected.")
        return cls(text, f"{_OPENERS[scheme]}:{host}:{port}")


def _host_and_port(text: str) -> tuple[str, int | None]:
    """Return host and port; no port where the address is not valid."""
    try:
        parts = urlsplit(text)
        port = parts.port
    except ValueError:
        return "", None
    if port is None or not 0 < port <= _MOST_PORT or parts.path not in ("", "/"):
        return "", None
    return parts.hostname or "0.0.0.0", port  # as in udpin://:14550
