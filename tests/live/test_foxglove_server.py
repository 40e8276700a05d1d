"""Foxglove WebSocket server: what clients receive, what they may ask for, and what slow ones lose."""

import json
import socket
import struct

import pytest
from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.sync.client import connect

from live.foxglove_server import FoxgloveServer
from survey import ConfigError, InputError

IMAGE, FIXED = "/camera/image", "/tf_static"
CHANNELS = {IMAGE: "foxglove.CompressedImage", FIXED: "foxglove.FrameTransforms"}


@pytest.fixture
def server():
    taken = []

    def receive(topic, content):
        taken.append((topic, content))
        return "" if topic == "/cmd_vel" else "that topic is refused."

    with FoxgloveServer("127.0.0.1:0", CHANNELS, receive, {"limit": "1"}) as running:
        running.taken = taken
        yield running


@pytest.fixture
def client(server):
    with connect(server.url, subprotocols=["foxglove.websocket.v1"]) as link:
        link.greeting = [json.loads(link.recv()), json.loads(link.recv())]
        yield link


def ask(link, **request):
    link.send(json.dumps(request))


def subscribe(link, *channels):
    ask(link, op="subscribe", subscriptions=[{"id": 7 + k, "channelId": k} for k in channels])


def next_message(link):
    return json.loads(link.recv(timeout=20))


def in_turn(link):
    """Wait until the server has done all that was asked before: it answers an unknown operation."""
    ask(link, op="nothing")
    return next_message(link)


def test_clients_are_told_the_channels_with_schemas(client):
    info, advertised = client.greeting
    assert client.subprotocol == "foxglove.websocket.v1"
    assert (info["op"], info["capabilities"], info["metadata"]) == (
        "serverInfo",
        ["clientPublish", "time"],
        {"limit": "1"},
    )
    assert [one["topic"] for one in advertised["channels"]] == [IMAGE, FIXED]
    assert json.loads(advertised["channels"][0]["schema"])["properties"]["format"] == {"type": "string"}


def test_a_message_arrives_with_subscription_and_time_until_it_is_unsubscribed(server, client):
    subscribe(client, 1)
    in_turn(client)
    server.publish(FIXED, 1.0, {"transforms": []})  # not subscribed to
    server.publish(IMAGE, 1.5, {"format": "jpeg"})
    data = client.recv(timeout=20)
    assert struct.unpack_from("<BIQ", data) == (1, 8, 1_500_000_000)
    assert json.loads(data[13:]) == {"format": "jpeg"}
    ask(client, op="unsubscribe", subscriptionIds=[8])
    in_turn(client)
    server.publish(IMAGE, 2.0, {})
    server.publish_time(2.25)
    assert struct.unpack("<BQ", client.recv(timeout=20)) == (2, 2_250_000_000)
    assert server.sent[IMAGE] == 1


def test_the_latest_of_a_static_topic_arrives_at_the_subscription(server, client):
    server.publish(FIXED, 0.0, {"transforms": [1]})
    server.publish(FIXED, 0.0, {"transforms": [2]})
    in_turn(client)
    subscribe(client, 2)
    assert json.loads(client.recv(timeout=20)[13:]) == {"transforms": [2]}


def test_what_clients_publish_is_taken_or_refused_with_a_sentence(server, client):
    channels = [{"id": k, "topic": topic, "encoding": "json"} for k, topic in enumerate(("/cmd_vel", "/x"))]
    ask(client, op="advertise", channels=channels)
    client.send(struct.pack("<BI", 1, 0) + b'{"a": 1}')
    client.send(struct.pack("<BI", 1, 1) + b"2")
    assert next_message(client) == {"op": "status", "level": 2, "message": "that topic is refused."}
    assert server.taken == [("/cmd_vel", {"a": 1}), ("/x", 2)]
    ask(client, op="unadvertise", channelIds=[0])
    client.send(struct.pack("<BI", 1, 0) + b"3")
    assert "was not advertised" in next_message(client)["message"]


@pytest.mark.parametrize(
    "data",
    [
        *("no JSON", "[]", "{}", "7", "[" * 60_000, b"", b"\x01", b"\x05abcdefgh"),
        *('{"op": "fetchAsset", "uri": "file:///etc/passwd"}', '{"op": "subscribe", "subscriptions": 3}'),
        *('{"op": "subscribe", "subscriptions": [{"id": -1, "channelId": 1}]}',),
        *('{"op": "subscribe", "subscriptions": [{"id": 1, "channelId": 99}]}',),
        *('{"op": "advertise", "channels": [{"id": 1, "topic": "/cmd_vel", "encoding": "cdr"}]}',),
        json.dumps(
            {"op": "advertise", "channels": [{"id": k, "topic": "t", "encoding": "json"} for k in range(99)]}
        ),
    ],
)
def test_malformed_requests_are_refused_and_the_connection_stays(client, data):
    client.send(data)
    assert next_message(client)["level"] == 2
    assert in_turn(client)["op"] == "status"


def test_a_message_that_is_too_large_ends_the_connection(client):
    client.send(b"x" * 70_000)
    with pytest.raises(ConnectionClosed) as closed:
        client.recv(timeout=20)
    assert closed.value.rcvd.code == 1009


def test_other_protocols_are_refused(server):
    with pytest.raises(InvalidStatus):
        connect(server.url)


def test_what_a_slow_client_loses_is_counted(server, client):
    subscribe(client, 1)
    in_turn(client)
    published = 600
    for _ in range(published):
        server.publish(IMAGE, 0.0, {"data": "x" * 40_000})
    with connect(server.url, subprotocols=["foxglove.sdk.v1"]) as other:  # others are not held up
        other.recv(), other.recv()
        in_turn(other)
    lost = server.dropped[IMAGE]
    assert lost > 0
    for _ in range(published - lost):
        client.recv(timeout=20)
    in_turn(client)
    assert (server.sent[IMAGE], server.dropped[IMAGE]) == (published - lost, lost)


def test_addresses_that_cannot_be_used_are_refused():
    with socket.create_server(("127.0.0.1", 0)) as busy:
        address = f"127.0.0.1:{busy.getsockname()[1]}"
        with pytest.raises(InputError, match=f"nothing can listen at {address} .Address already in use.; "):
            FoxgloveServer(address, CHANNELS, lambda *_: "", {})
    for text in ("8765", "localhost", "localhost:x", "localhost:99999", ":8765", "a@b:1", "h:1/path"):
        with pytest.raises(ConfigError, match="HOST:PORT was expected"):
            FoxgloveServer(text, CHANNELS, lambda *_: "", {})
