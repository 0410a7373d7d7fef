"""The studio's server: whose page may talk to it, and what it makes of any bytes."""

from __future__ import annotations

import random
import socket
from collections.abc import Iterator
from typing import Any

import pytest

from mam_pipeline.local_page import is_own
from mam_sim.studio.server import start
from tests.pipeline.test_fuzz import DEEP, changed, replaced

viser = pytest.importorskip("viser", reason="the studio's extra is not installed")
msgpack = pytest.importorskip("msgspec", reason="viser speaks through it").msgpack
OWN = ["127.0.0.1:80"]


@pytest.mark.parametrize(("hosts", "origins"), [
    (OWN, None), (OWN, []), (OWN, ["http://127.0.0.1:80"]), (OWN, ["http://localhost:80"]),
    (["localhost:80"], ["http://localhost:80"]),
])  # fmt: skip
def test_own_page_pass(hosts: list[str], origins: list[str] | None) -> None:
    assert is_own(hosts, origins, 80)


@pytest.mark.parametrize(("hosts", "origins"), [
    (None, None), ([], None), ([""], None), (["127.0.0.1"], None), (["127.0.0.1:81"], None),
    (["evil.example"], None), (["127.0.0.1:80.evil"], None), ([*OWN, *OWN], None),
    (OWN, ["null"]), (OWN, [""]), (OWN, ["http://127.0.0.1:81"]), (OWN, ["https://127.0.0.1:80"]),
    (OWN, ["http://evil.example"]), (OWN, ["http://127.0.0.1:80@evil"]), (OWN, ["127.0.0.1:80"]),
    (OWN, ["http://evil/127.0.0.1:80"]), (OWN, ["http://127.0.0.1:80", "http://evil"]),
])  # fmt: skip
def test_own_page_fail(hosts: list[str] | None, origins: list[str] | None) -> None:
    assert not is_own(hosts, origins, 80)


@pytest.fixture(scope="module")
def port() -> Iterator[int]:
    server = start(0, "test")
    yield server.get_port()
    server.stop()


def joined(port: int, origin: int | None = None) -> tuple[socket.socket, bytes]:
    """A connection that asked to speak WebSocket, and the first line of the answer."""
    sock = socket.create_connection(("127.0.0.1", port), timeout=20)
    rows = [
        "GET / HTTP/1.1", f"Host: 127.0.0.1:{port}", "Connection: Upgrade", "Upgrade: websocket",
        "Sec-WebSocket-Version: 13", "Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==",
        f"Sec-WebSocket-Protocol: viser-v{viser.__version__}",
        *([] if origin is None else [f"Origin: http://127.0.0.1:{origin}"]),
    ]  # fmt: skip
    sock.sendall("\r\n".join([*rows, "", ""]).encode())
    return sock, sock.recv(400).partition(b"\r\n")[0]


def frame(data: bytes, kind: int = 2) -> bytes:
    """One masked frame of WebSocket."""
    size = bytes([0x80 | len(data)]) if len(data) < 126 else b"\xfe" + len(data).to_bytes(2, "big")
    return bytes([0x80 | kind]) + size + bytes(4) + data


def ends(sock: socket.socket) -> None:
    """Read until the server has closed the connection."""
    with sock:
        sock.shutdown(socket.SHUT_WR)
        while sock.recv(1 << 16):
            pass


def test_pages_of_other_ports_are_refused(port: int) -> None:
    for origin, status in ((None, b"101"), (port, b"101"), (port + 1, b"403")):
        sock, answer = joined(port, origin)
        assert status in answer
        sock.close()


CAMERA = {
    "type": "ViewerCameraMessage", "wxyz": [1, 0, 0, 0], "position": [0, 0, 1], "fov": 1.0,
    "image_height": 10, "image_width": 10, "look_at": [0, 0, 0], "up_direction": [0, 0, 1],
    "near": 0.1, "far": 10.0,
}  # fmt: skip
CLICK = {
    "type": "ScenePointerMessage", "event_type": "click", "ray_origin": [0, 0, 1],
    "ray_direction": [0, 0, -1], "screen_pos": [[0.5, 0.5]], "modifier": None,
}  # fmt: skip
EDIT = {"type": "GuiUpdateMessage", "uuid": "x", "updates": {"value": 1}}
WRONG: list[bytes] = [
    frame(b"\xc1"), frame(b"hello", 1), frame(b"\xff\xfe", 1), frame(b"\xc0"), b"\x82\x01x",
    b"\xf2\x80\0\0\0\0", bytes(300), frame(b"\0", 8), frame(b"\x91" * 60_000),
    frame(msgpack.encode([1])), frame(msgpack.encode({"type": "Nope"})),
    frame(msgpack.encode({**CLICK, "ray_origin": None})),
    frame(msgpack.encode({**CAMERA, "fov": None})),
]  # fmt: skip


def test_messages_of_any_values_end_their_connection_alone(
    port: int, capfd: pytest.CaptureFixture[str]
) -> None:
    rng = random.Random(0)
    told: list[bytes] = list(WRONG)
    for _ in range(DEEP or 25):
        try:
            data = msgpack.encode(replaced(rng.choice((CAMERA, CLICK, EDIT)), rng))
        except OverflowError:  # no message can hold such a number
            continue
        told.append(frame(changed(data, rng) if rng.random() < 0.5 else data))
    for message in told:
        sock, answer = joined(port)
        assert b"101" in answer, "the server still answers"
        sock.sendall(message)
        ends(sock)
    said: Any = capfd.readouterr()
    assert "Traceback" not in said.err + said.out
    assert "something that is no message" in said.err
