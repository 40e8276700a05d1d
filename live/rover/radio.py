"""UDP socket of the simulated rover, with a radio link that loses packets."""

import socket
from contextlib import suppress

from survey.core.errors import InputError
from survey.core.streams import stream

_LARGEST = 65_535


class Radio:
    """Datagrams to and from the ground station that was heard last.

    `host`: address to listen at. `port`: UDP port; 0 for a free one. `loss`: share of packets that are lost,
    in either direction. `seed`: of the losses.
    """

    def __init__(self, host: str, port: int, loss: float = 0.0, seed: int = 0) -> None:
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 1 << 21)
        try:
            self._socket.bind((host, port))
        except OSError as error:
            self._socket.close()
            raise InputError(
                f"the rover cannot listen at {host}:{port} ({error.strerror}); choose another port."
            ) from error
        self._loss = loss
        self._up, self._down = stream(seed, "live.radio.up"), stream(seed, "live.radio.down")
        self._peer: tuple[str, int] | None = None

    @property
    def port(self) -> int:
        """Port that it listens at."""
        return int(self._socket.getsockname()[1])

    def receive(self, timeout_s: float) -> bytes | None:
        """Return the next datagram that arrives, or None after a time.

        `timeout_s`: how long to wait [s]. Returns: a datagram; None also for one that was lost.
        """
        self._socket.settimeout(timeout_s)
        try:
            data, self._peer = self._socket.recvfrom(_LARGEST)
        except (TimeoutError, ConnectionError):
            return None
        return None if self._up.random() < self._loss else data

    def send(self, data: bytes) -> None:
        """Send a datagram to the ground station, unless it is lost or nobody was heard yet."""
        if self._peer is None or self._down.random() < self._loss:
            return
        with suppress(OSError):
            self._socket.sendto(data, self._peer)

    def close(self) -> None:
        """Close the socket."""
        self._socket.close()
