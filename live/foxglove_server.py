"""Server of the Foxglove WebSocket protocol, version 1, with messages as JSON.

Specification: https://github.com/foxglove/ws-protocol/blob/main/docs/spec.md. The server runs in a thread of its own, so that
slow clients hold nobody up: messages wait in a queue for each client, and those that find it full are dropped and counted.
What clients send is limited in size and number. A message that a client publishes goes to one function; no other request
does anything but choose what this client receives, and none reads or writes a file.
"""

import asyncio
import json
import logging
import socket
import struct
import threading
from collections import Counter
from collections.abc import Callable, Mapping
from contextlib import suppress
from typing import Any, Self
from urllib.parse import urlsplit

from websockets.asyncio.server import ServerConnection, serve
from websockets.exceptions import ConnectionClosed
from websockets.typing import Data, Subprotocol

from live.foxglove import NANO, SCHEMAS
from survey import ConfigError, InputError

logger = logging.getLogger(__name__)

PROTOCOLS = (Subprotocol("foxglove.sdk.v1"), Subprotocol("foxglove.websocket.v1"))
"""Two names of one protocol."""
_LARGEST_BYTES, _MOST_CLIENTS, _MOST_TOPICS = 65_536, 16, 64
_MOST_WAITING = 256
_DRAINED_S = 2.0
_MOST_ID = 2**32 - 1
_DATA, _TIME, _PUBLISHED = struct.Struct("<BIQ"), struct.Struct("<BQ"), struct.Struct("<BI")
_DATA_CODE, _TIME_CODE, _PUBLISHED_CODE = 1, 2, 1
_ERROR = 2
_UNBRACKETED = str.maketrans("", "", "[]")
_TRY_LATER = 1013
_MALFORMED = "the message is not one of the Foxglove WebSocket protocol v1; see its specification."

Receive = Callable[[str, Any], str]
"""Called with topic and content of a message that a client publishes; returns why it is refused, or nothing."""


def listening_socket(address: str) -> socket.socket:
    """Return a socket that listens at HOST:PORT; port 0 is a free one."""
    try:
        parts = urlsplit(f"//{address}")
        host, port = parts.hostname, parts.port
    except ValueError:
        host, port = None, None
    if host is None or port is None or f"{host}:{port}" != address.lower().translate(_UNBRACKETED):
        raise ConfigError(f"{address!r} is no address; HOST:PORT was expected, such as 127.0.0.1:8765.")
    try:
        family = socket.AF_INET6 if ":" in host else socket.AF_INET
        return socket.create_server((host, port), family=family)
    except OSError as error:
        reason = str(error.strerror).partition(" (while")[0]
        raise InputError(
            f"nothing can listen at {address} ({reason}); choose another address with --listen."
        ) from error


class _Client:
    """Connection of one client: what it receives by channel, what it publishes, and what waits to be sent."""

    def __init__(self, connection: ServerConnection) -> None:
        self.connection = connection
        self.subscriptions: dict[int, int] = {}
        self.topics: dict[int, str] = {}
        self.waiting: asyncio.Queue[tuple[str, Data]] = asyncio.Queue(_MOST_WAITING)

    def offer(self, data: Data, topic: str = "") -> bool:
        """Let a message wait to be sent; return whether there was room."""
        with suppress(asyncio.QueueFull):
            self.waiting.put_nowait((topic, data))
            return True
        return False

    def send_later(self, **message: Any) -> None:
        """Let a message of the protocol wait to be sent."""
        self.offer(json.dumps(message))


class FoxgloveServer:
    """Server of some channels, from when it is entered.

    `address`: HOST:PORT. `channels`: schema of each topic; topics of which the latest message counts end in ``_static``.
    `receive`: takes what clients publish, in the thread of the server. `metadata`: facts about the server that clients receive.

    ``url`` is the address for clients. ``sent`` and ``dropped`` count messages by topic, over all clients. ``connected`` is
    set by the first client.
    """

    def __init__(
        self, address: str, channels: Mapping[str, str], receive: Receive, metadata: Mapping[str, str]
    ) -> None:
        self._socket, self._receive, self._metadata = listening_socket(address), receive, metadata
        self._ids = {topic: number for number, topic in enumerate(channels, start=1)}
        self._advertised = [_advertised(self._ids[topic], topic, name) for topic, name in channels.items()]
        self._clients: set[_Client] = set()
        self._kept: dict[int, tuple[int, bytes]] = {}
        self.sent: Counter[str] = Counter()
        self.dropped: Counter[str] = Counter()
        self.connected = threading.Event()
        host, port = self._socket.getsockname()[:2]
        self.url = f"ws://{f'[{host}]' if ':' in host else host}:{port}"
        self._ready, self._thread = (
            threading.Event(),
            threading.Thread(target=lambda: asyncio.run(self._run())),
        )

    def __enter__(self) -> Self:
        self._thread.start()
        self._ready.wait()
        return self

    def __exit__(self, *_: object) -> None:
        """Send what waits, as far as clients read it, and close all connections."""
        if self._thread.is_alive():
            self._loop.call_soon_threadsafe(self._stop.set)
            self._thread.join()

    def publish(self, topic: str, time_s: float, message: Mapping[str, Any]) -> None:
        """Send a message to all who subscribed to its topic."""
        stamp, payload = round(time_s * NANO), json.dumps(message).encode()
        self._loop.call_soon_threadsafe(self._offer, topic, stamp, payload)

    def publish_time(self, time_s: float) -> None:
        """Send the time to all clients."""
        data = _TIME.pack(_TIME_CODE, round(time_s * NANO))
        self._loop.call_soon_threadsafe(lambda: [client.offer(data) for client in self._clients])

    async def _run(self) -> None:
        self._loop, self._stop = asyncio.get_running_loop(), asyncio.Event()
        options: dict[str, Any] = {"max_size": _LARGEST_BYTES, "compression": None, "logger": logger}
        async with serve(self._converse, sock=self._socket, subprotocols=PROTOCOLS, **options):
            self._ready.set()
            await self._stop.wait()
            drained = [asyncio.create_task(client.waiting.join()) for client in self._clients]
            if drained:
                _, late = await asyncio.wait(drained, timeout=_DRAINED_S)
                for task in late:
                    task.cancel()

    async def _converse(self, connection: ServerConnection) -> None:
        """Serve one client until it leaves."""
        if len(self._clients) >= _MOST_CLIENTS:
            await connection.close(_TRY_LATER, f"{_MOST_CLIENTS} clients are connected")
            return
        client = _Client(connection)
        info = {"capabilities": ["clientPublish", "time"], "supportedEncodings": ["json"]}
        client.send_later(op="serverInfo", name="firnline", metadata=self._metadata, **info)
        client.send_later(op="advertise", channels=self._advertised)
        self._clients.add(client)
        self.connected.set()
        sender = asyncio.create_task(self._send(client))
        try:
            with suppress(ConnectionClosed):
                async for data in connection:
                    refusal = self._take(client, data)
                    if refusal:
                        client.send_later(op="status", level=_ERROR, message=refusal)
        finally:
            self._clients.discard(client)
            sender.cancel()

    async def _send(self, client: _Client) -> None:
        """Send what waits for a client."""
        with suppress(ConnectionClosed):
            while True:
                topic, data = await client.waiting.get()
                await client.connection.send(data)
                client.waiting.task_done()
                self.sent[topic] += 1

    def _offer(self, topic: str, stamp: int, payload: bytes) -> None:
        channel = self._ids[topic]
        if topic.endswith("_static"):
            self._kept[channel] = stamp, payload
        for client in self._clients:
            if channel in client.subscriptions:
                data = _DATA.pack(_DATA_CODE, client.subscriptions[channel], stamp) + payload
                self.dropped[topic] += not client.offer(data, topic)

    def _take(self, client: _Client, data: Data) -> str:
        """Do what a client asks for; return why it is refused, or nothing."""
        try:
            if isinstance(data, bytes):
                code, number = _PUBLISHED.unpack_from(data)
                if code != _PUBLISHED_CODE or number not in client.topics:
                    return "a message for a channel that was not advertised is refused; advertise it first."
                return self._receive(client.topics[number], json.loads(data[_PUBLISHED.size :]))
            return self._asked(client, json.loads(data))
        except (ValueError, KeyError, TypeError, RecursionError, struct.error):
            return _MALFORMED

    def _asked(self, client: _Client, request: dict[str, Any]) -> str:
        match request["op"]:
            case "subscribe":
                return "".join(self._subscribe(client, one) for one in request["subscriptions"])
            case "unsubscribe":
                gone = set(request["subscriptionIds"])
                client.subscriptions = {c: s for c, s in client.subscriptions.items() if s not in gone}
            case "advertise":
                topics = {_number(one["id"]): str(one["topic"]) for one in request["channels"]}
                if len(client.topics | topics) > _MOST_TOPICS:
                    return f"a client may publish {_MOST_TOPICS} channels; unadvertise others first."
                if any(one["encoding"] != "json" for one in request["channels"]):
                    return "channels of clients are refused whose encoding is not json."
                client.topics |= topics
            case "unadvertise":
                for number in request["channelIds"]:
                    client.topics.pop(number, None)
            case _:
                return "the operation is not supported; subscribe, unsubscribe, advertise or unadvertise was expected."
        return ""

    def _subscribe(self, client: _Client, asked: dict[str, Any]) -> str:
        number, channel = _number(asked["id"]), asked["channelId"]
        if channel not in self._ids.values():
            return "there is no channel of that id; take one that was advertised."
        client.subscriptions[channel] = number
        if channel in self._kept:
            stamp, payload = self._kept[channel]
            client.offer(_DATA.pack(_DATA_CODE, number, stamp) + payload)
        return ""


def _number(value: Any) -> int:
    """Return an id of 32 bits."""
    if not isinstance(value, int) or not 0 <= value <= _MOST_ID:
        raise ValueError(value)
    return value


def _advertised(number: int, topic: str, name: str) -> dict[str, Any]:
    """Return a channel as it is advertised to clients."""
    schema = {"schemaName": name, "schema": json.dumps(SCHEMAS[name.partition(".")[2]]), "schemaEncoding": "jsonschema"}  # fmt: skip
    return {"id": number, "topic": topic, "encoding": "json", **schema}
