"""Who knocks at a view without its secret, from another page or under another name, gets nothing: real sockets."""

from __future__ import annotations

import base64
import http.client
import socket
from collections.abc import Iterator

import pytest

pytest.importorskip("viser", reason="the view needs viser: install 'coheft[view]'")

import viser
from viser._messages import ShareUrlRequest
from websockets.exceptions import InvalidStatus
from websockets.sync.client import connect
from websockets.typing import Origin, Subprotocol

from coheft.app.view import server as server_module
from coheft.app.view.door import REFUSAL
from coheft.app.view.place import Place
from coheft.app.view.server import open_server
from coheft.errors import CoheftError
from tests.ports import free_port

TOKEN = "the-secret"
VISER = [Subprotocol(f"viser-v{viser.__version__}")]


@pytest.fixture(scope="module")
def port() -> Iterator[int]:
    with open_server(Place("127.0.0.1", free_port(), TOKEN)) as server:
        server.gui.add_markdown("a secret state")
        yield server.get_port()


def ask(port: int, path: str, *lines: str, host: str = "127.0.0.1") -> tuple[int, bytes]:
    """Status and body of an answer to a request with exactly these header lines."""
    with socket.create_connection((host, port), timeout=30.0) as client:
        client.sendall("\r\n".join([f"GET {path} HTTP/1.1", *lines, "", ""]).encode("latin-1"))
        answer = http.client.HTTPResponse(client)
        answer.begin()
        return answer.status, b"" if answer.status == 101 else answer.read()


def socket_lines() -> list[str]:
    key = base64.b64encode(bytes(16)).decode()
    return ["Upgrade: websocket", "Connection: Upgrade", f"Sec-WebSocket-Key: {key}", "Sec-WebSocket-Version: 13"]


def refused(answer: tuple[int, bytes]) -> bool:
    return answer == (403, REFUSAL)


def test_who_has_the_secret_gets_page_and_socket(port: int) -> None:
    here = f"127.0.0.1:{port}"
    for host in (here, f"localhost:{port}", f"LocalHost:{port}"):
        for path in (f"/{TOKEN}/", f"/{TOKEN}", f"/{TOKEN}/?darkMode", f"/{TOKEN}/index.html"):
            status, body = ask(port, path, f"Host: {host}")
            assert status == 200
            assert b"iser" in body
    with connect(f"ws://{here}/{TOKEN}", origin=Origin(f"http://{here}"), subprotocols=VISER) as link:
        assert link.recv(timeout=30.0)


@pytest.mark.parametrize(
    "path",
    ["/", "/index.html", "/wrong/", f"/{TOKEN}x/", f"/{TOKEN[:-1]}/", f"/?token={TOKEN}", f"//{TOKEN}/", "/é/",
     f"/x/../{TOKEN}/", f"/{TOKEN.upper()}/", f"/{TOKEN}%2F", "/favicon.ico"],
)  # fmt: skip
def test_without_the_secret_there_is_neither_page_nor_asset_nor_socket(port: int, path: str) -> None:
    here = f"Host: 127.0.0.1:{port}", f"Origin: http://127.0.0.1:{port}"
    assert refused(ask(port, path, *here))
    assert refused(ask(port, path, *here, *socket_lines()))
    with pytest.raises(InvalidStatus, match="403"), connect(f"ws://127.0.0.1:{port}{path}", subprotocols=VISER):
        pass


@pytest.mark.parametrize(
    "lines",
    [
        [],
        ["Host: evil.example:{port}"],
        ["Host: evil.example"],
        ["Host: 127.0.0.1"],
        ["Host: 127.0.0.1:1"],
        ["Host: localhost.evil.example:{port}"],
        ["Host: 127.0.0.1:{port}.evil.example"],
        ["Host: 127.0.0.1.:{port}"],
        ["Host: 192.0.2.1:{port}"],
        ["Host: 127.0.0.1:{port}", "Host: evil.example:{port}"],
        ["Host: "],
    ],
)
def test_under_another_name_nothing_is_answered_even_to_who_has_the_secret(port: int, lines: list[str]) -> None:
    given = [line.format(port=port) for line in lines]
    assert refused(ask(port, f"/{TOKEN}/", *given))
    assert refused(ask(port, f"/{TOKEN}", *given, "Origin: http://evil.example", *socket_lines()))
    assert refused(ask(port, f"/{TOKEN}", *given, f"Origin: http://127.0.0.1:{port}", *socket_lines()))
    if given:  # a name that was made to lead here: page and socket agree on it
        same = given[0].removeprefix("Host: ")
        assert refused(ask(port, f"/{TOKEN}", *given, f"Origin: http://{same}", *socket_lines()))


@pytest.mark.parametrize(
    "origin",
    [
        "http://evil.example",
        "null",
        "",
        "http://127.0.0.1",
        "http://127.0.0.1:1",
        "http://localhost:{port}",
        "https://127.0.0.1:{port}",
        "http://127.0.0.1:{port}.evil.example",
        "http://127.0.0.1:{port}\r\nOrigin: http://127.0.0.1:{port}",
    ],
)
def test_another_page_gets_nothing_even_if_it_has_the_secret(port: int, origin: str) -> None:
    lines = f"Host: 127.0.0.1:{port}", f"Origin: {origin.format(port=port)}"
    assert refused(ask(port, f"/{TOKEN}/", *lines))
    assert refused(ask(port, f"/{TOKEN}", *lines, *socket_lines()))


def test_a_socket_says_from_which_page_it_is(port: int) -> None:
    assert refused(ask(port, f"/{TOKEN}", f"Host: 127.0.0.1:{port}", *socket_lines()))


def test_no_other_page_gets_address_or_content(port: int) -> None:
    connection = http.client.HTTPConnection("127.0.0.1", port, timeout=30.0)
    for path in (f"/{TOKEN}/", "/"):
        connection.request("GET", path)
        answer = connection.getresponse()
        answer.read()
        assert answer.headers["Referrer-Policy"] == "no-referrer"
        assert answer.headers["Content-Security-Policy"] == "frame-ancestors 'none'"
        assert answer.headers["Cross-Origin-Resource-Policy"] == "same-origin"
        connection.close()


def test_no_page_can_make_the_view_public() -> None:
    with open_server(Place.choose("127.0.0.1", free_port())) as server:
        assert ShareUrlRequest not in server._websock_server._incoming_handlers


def test_who_is_refused_is_told_where_the_address_is() -> None:
    assert b"the terminal after" in REFUSAL
    assert b"coheft view" in REFUSAL


def test_each_view_has_a_secret_of_its_own(port: int) -> None:
    urls = {Place.choose("127.0.0.1").url for _ in range(100)}
    assert len(urls) == 100
    assert min(map(len, urls)) > len(f"http://127.0.0.1:{port}/") + 20


def test_all_addresses_of_this_machine_are_its_own_but_no_names_of_others() -> None:
    with open_server(Place("0.0.0.0", free_port(), TOKEN)) as server:
        port = server.get_port()
        for host in ("127.0.0.1", "127.0.0.2", socket.gethostname()):
            dialled = host if host.startswith("127") else "127.0.0.1"
            assert ask(port, f"/{TOKEN}/", f"Host: {host}:{port}", host=dialled)[0] == 200
        for host in ("evil.example", "192.0.2.1", "0.0.0.0"):
            assert refused(ask(port, f"/{TOKEN}/", f"Host: {host}:{port}"))


def test_a_release_of_viser_that_cannot_be_guarded_shows_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    class Elsewhere:
        """As if viser called the library by another name."""

    port = free_port()
    monkeypatch.setattr(server_module, "sockets", Elsewhere)
    Elsewhere.serve = None
    with pytest.raises(CoheftError, match="cannot be guarded"), open_server(Place("127.0.0.1", port, TOKEN)):
        pytest.fail("it shows something")
    with pytest.raises(ConnectionRefusedError):
        socket.create_connection(("127.0.0.1", port), timeout=1.0)
