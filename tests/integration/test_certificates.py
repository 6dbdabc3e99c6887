"""Who dials in, and who is dialled, has to have a valid certificate; a link ends with it."""

from __future__ import annotations

import time
from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest
import zenoh
from cryptography import x509

from coheft.app.run.keys import Authority, make_keys
from coheft.errors import CoheftError
from coheft.wire.transport.planes import guard_neighbours
from coheft.wire.transport.security import Credentials, credentials_in
from coheft.wire.transport.sessions import open_session
from tests.ports import free_port
from tests.waiting import wait_until

from .attacker import raw_session, tls_settings
from .certificates import authority_in
from .team import small_scenario
from .test_security import KEYS, OPEN, victim


def test_clocks_may_differ_by_some_minutes(tmp_path: Path) -> None:
    make_keys(tmp_path / "keys", small_scenario(2, "line"))
    for path in (tmp_path / "keys").glob("*.crt"):
        certificate = x509.load_pem_x509_certificate(path.read_bytes())
        assert certificate.not_valid_before_utc < datetime.now(UTC) - timedelta(minutes=4), path


def without_certificate(_: Path, good: Credentials) -> dict[str, object]:
    return {"root_ca_certificate": good.authority}


def of_another_authority(folder: Path, good: Credentials) -> dict[str, object]:
    Authority.new(timedelta(days=1)).issue(folder, "r2")
    return tls_settings(_with_authority_of(folder, good))


def self_signed_authority(folder: Path, good: Credentials) -> dict[str, object]:
    """An authority that calls itself as ours does is no help."""
    make_keys(folder, small_scenario(4))
    return tls_settings(_with_authority_of(folder, good))


def expired(folder: Path, good: Credentials) -> dict[str, object]:
    authority_in(Path(good.authority).parent).issue(folder, "r2", lifetime=timedelta(seconds=-1))
    return tls_settings(_with_authority_of(folder, good))


def fresh(folder: Path, good: Credentials) -> dict[str, object]:
    """The control: made like the expired one, but good."""
    authority_in(Path(good.authority).parent).issue(folder, "r2", lifetime=timedelta(hours=1))
    return tls_settings(_with_authority_of(folder, good))


def _with_authority_of(folder: Path, good: Credentials) -> Credentials:
    return Credentials(authority=good.authority, certificate=str(folder / "r2.crt"), key=str(folder / "r2.key"))


BAD_CERTIFICATES = [without_certificate, of_another_authority, self_signed_authority, expired]


@pytest.mark.parametrize("certificate", BAD_CERTIFICATES)
def test_without_a_valid_certificate_no_one_dials_in(secure, tmp_path, certificate):
    good = secure.credentials("r2")
    bad = certificate(tmp_path / "bad", good)
    with victim(secure, "neighbour plane of r1") as (endpoint, _):
        with raw_session([endpoint], tls=fresh(tmp_path / "fresh", good)) as session:
            assert [link.auth_identifier for link in session.info.links()] == ["r1"]
        with pytest.raises(zenoh.ZError, match="Unable to connect"), raw_session([endpoint], tls=bad):
            pass


def test_no_one_dials_in_over_plain_tcp(secure):
    with victim(OPEN, "neighbour plane of r1") as (endpoint, _), raw_session([endpoint]) as session:
        assert len(session.info.links()) == 1
    with (
        victim(secure, "neighbour plane of r1") as (endpoint, _),
        pytest.raises(zenoh.ZError, match="Unable to connect"),
        raw_session([endpoint.replace("tls", "tcp")]),
    ):
        pass


@pytest.mark.parametrize("certificate", [*BAD_CERTIFICATES[1:], None])
def test_without_a_valid_certificate_no_one_is_dialled(secure, tmp_path, certificate):
    """Whoever takes the port of a neighbour that is down needs more than the port."""
    good = secure.credentials("r2")
    endpoint = secure.endpoint(free_port())
    guard = guard_neighbours(secure.credentials("r1"), KEYS, "r1", ["r2"])
    with open_session(connect=[endpoint], guard=guard) as session:
        bad = certificate(tmp_path / "bad", good) if certificate is not None else {}
        at_the_port = endpoint if certificate is not None else endpoint.replace("tls", "tcp")
        with raw_session(listen=[at_the_port], tls=bad) as impostor:
            time.sleep(0.5)
            assert impostor.info.links() == session.info.links() == []
        with raw_session(listen=[endpoint], tls=tls_settings(good)):
            wait_until(lambda: len(session.info.links()) == 1, "the real one")


def test_a_link_does_not_outlive_its_certificate(secure, tmp_path):
    with victim(secure, "neighbour plane of r1") as (endpoint, session):
        authority_in(secure.keys).issue(tmp_path, "r2", lifetime=timedelta(seconds=8))
        with raw_session([endpoint], tls=tls_settings(_with_authority_of(tmp_path, secure.credentials("r2")))):
            assert len(session.info.links()) == 1
            wait_until(lambda: session.info.links() == [], "the end of the certificate")


def test_a_missing_certificate_is_named(secure):
    with pytest.raises(CoheftError, match=r"contains no r9.crt and no r9.key, needed by r9"):
        credentials_in(secure.keys, "r9")
