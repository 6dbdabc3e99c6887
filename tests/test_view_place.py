"""Where the view listens."""

from __future__ import annotations

import http.client
import socket

import pytest

from coheft.app.run.processes import ProcessError
from coheft.app.view import place
from coheft.app.view.place import PORT, Place, choose_port
from coheft.app.view.process import READY, ViewBeside, ViewConfig
from coheft.errors import LinkError
from tests.ports import free_port


def has_ipv6() -> bool:
    try:
        with socket.socket(socket.AF_INET6) as probe:
            probe.bind(("::1", 0))
    except OSError:
        return False
    return True


needs_ipv6 = pytest.mark.skipif(not has_ipv6(), reason="this machine has no IPv6")
HOSTS = ["127.0.0.1", pytest.param("::1", marks=needs_ipv6)]


@pytest.fixture(params=HOSTS)
def taken(request):
    family = socket.AF_INET6 if ":" in request.param else socket.AF_INET
    with socket.socket(family) as listener:
        listener.bind((request.param, 0))
        listener.listen()
        yield request.param, listener.getsockname()[1]


@pytest.mark.slow
def test_a_run_does_not_begin_without_the_view_that_it_was_asked_for(taken, tmp_path):
    with ViewBeside(ViewConfig(str(tmp_path), Place(*taken, "secret"))) as view:
        with pytest.raises(ProcessError, match=r"view ended with status 1(?s:.*)the view cannot listen at"):
            view.wait_for(READY)
        assert not view.is_there
        assert not view.wait_for_another()


@pytest.mark.parametrize("host", ["", "localhost", "0.0.0.0", *HOSTS, pytest.param("::", marks=needs_ipv6)])
def test_a_free_port_is_taken_as_it_was_asked_for(host):
    port = free_port()
    assert choose_port(host, port) == port
    assert choose_port(host, None) >= PORT


def test_a_port_where_somebody_listens_is_refused_or_passed_over(taken, monkeypatch):
    host, port = taken
    with pytest.raises(LinkError, match=r"cannot listen at .*127.0.0.1:\d+:|cannot listen at \[::1\]:\d+:"):
        choose_port(host, port)
    monkeypatch.setattr(place, "PORT", port)
    assert choose_port(host, None) > port


@needs_ipv6
def test_all_addresses_of_a_host_have_to_be_free(monkeypatch):
    def both(host, port, *_):
        return [
            (socket.AF_INET, socket.SOCK_STREAM, 6, "", ("127.0.0.1", port)),
            (socket.AF_INET6, socket.SOCK_STREAM, 6, "", ("::1", port, 0, 0)),
        ]

    monkeypatch.setattr(socket, "getaddrinfo", both)
    with socket.socket(socket.AF_INET6) as listener:
        listener.bind(("::1", 0))
        listener.listen()
        with pytest.raises(LinkError, match="in use"):
            choose_port("both", listener.getsockname()[1])


@needs_ipv6
def test_ipv6_does_not_want_ports_of_ipv4():
    with socket.socket() as listener:
        listener.bind(("0.0.0.0", 0))
        listener.listen()
        port = listener.getsockname()[1]
        assert choose_port("::", port) == port


def test_an_address_that_is_none_of_this_machines_is_refused_with_a_reason():
    for host in ("192.0.2.1", "no such host"):
        with pytest.raises(LinkError, match=f"cannot listen at {host}, ports .*: .*; choose others"):
            choose_port(host, None)


def test_browsers_get_addresses_that_they_understand():
    own = socket.gethostname()
    for host, shown in {
        "127.0.0.1": "127.0.0.1",
        "::1": "[::1]",
        "a.example": "a.example",
        "0.0.0.0": own,
        "::": own,
    }.items():
        assert Place(host, 8010, "x").url == f"http://{shown}:8010/x/"


@needs_ipv6
def test_a_view_can_be_had_at_an_ipv6_address():
    pytest.importorskip("viser", reason="the view needs viser: install 'coheft[view]'")
    from coheft.app.view.server import open_server

    port = free_port()
    with open_server(Place("::1", port, "secret")):
        connection = http.client.HTTPConnection("::1", port, timeout=30.0)
        try:
            connection.request("GET", "/secret/")
            assert connection.getresponse().status == 200
        finally:
            connection.close()
