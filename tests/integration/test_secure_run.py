"""Secure runs of real processes: what roles may do, and what a neighbour that floods can spoil."""

from __future__ import annotations

import os
import shutil
import stat
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from datetime import UTC, datetime, timedelta
from pathlib import Path

import msgspec
import pytest
import zenoh
from cryptography import x509

from coheft.app.cli.base import EXIT_CONVERGED, EXIT_ERROR
from coheft.app.cli.main import run_command_line
from coheft.app.run.hosts import Hosts, load_hosts
from coheft.app.run.keys import check_keys, make_keys
from coheft.app.run.plan import make_plan
from coheft.errors import CoheftError, LinkError, ScenarioError
from coheft.wire.config import AgentProcessConfig
from coheft.wire.messages.requests import EstimatorRequest, InjectRequest, Refusal, Status, StatusRequest, StopRequest
from coheft.wire.messages.structs import Hello, Ready
from coheft.wire.process.problem_log import BURST, RATE
from coheft.wire.transport import backlog as backlog_module
from coheft.wire.transport.inbox import Inbox, Received, Refused
from coheft.wire.transport.planes import guard_observer
from coheft.wire.transport.sessions import Keys, Role, Sender, ask, open_session
from tests.ports import free_port

from .attacker import Profile, raw_session, tls_settings
from .certificates import authority_in
from .team import LIMIT, Team, running_team, small_scenario, wait_until

COUNT = 4


@pytest.fixture
def secure(tmp_path: Path) -> Profile:
    make_keys(tmp_path / "keys", small_scenario(COUNT))
    return Profile(tmp_path / "keys")


@contextmanager
def role_at(team: Team, profile: Profile, role: Role) -> Iterator[zenoh.Session]:
    guard = guard_observer(profile.credentials(role), team.keys, role, [])
    with open_session(connect=[team.plan.server.observe], guard=guard) as session:
        yield session


def asked(session: zenoh.Session, key: str, request: StatusRequest | InjectRequest) -> Status | Refusal:
    """The answer, as soon as the link stands."""
    answers: list[Status | Refusal] = []

    def is_answered() -> bool:
        try:
            answers.append(ask(Status, session, key, request, timeout=0.5))
        except LinkError:
            return False
        return True

    wait_until(is_answered, "an answer")
    return answers[0]


def test_only_the_operator_changes_the_load_and_the_server_tells_who_tried(secure, tmp_path):
    load = InjectRequest(mass=0.5, position=(0.1, 0.0, 0.1))
    with running_team(small_scenario(COUNT), tmp_path, keys_folder=secure.keys) as team:
        team.wait_for_block(1)
        with role_at(team, secure, "observer") as session:
            status = asked(session, team.keys.request("observer"), StatusRequest())
            assert isinstance(status, Status)
            for request in (load, EstimatorRequest(estimator="fan2017")):
                refused = asked(session, team.keys.request("observer"), request)
                assert isinstance(refused, Refusal)
                assert "only the operator may change a run" in refused.reason
            with pytest.raises(LinkError, match="no answer"):
                ask(Status, session, team.keys.request("operator"), load, timeout=1.0)
        assert team.ask(StatusRequest()).loads == []
        with role_at(team, secure, "operator") as session:
            done = asked(session, team.keys.request("operator"), load)
            assert isinstance(done, Status)
            assert [load.mass for load in done.loads] == [0.5]
            assert done.estimator == "efficient"
        team.ask(StopRequest())
        assert team.exit_status("server") == 0
        log = team.log("server")
        assert "refused to the observer: add a load of 0.5 kg at" in log
        assert "done for the operator before block" in log


def test_a_robots_certificate_shows_it_no_truth(secure, tmp_path):
    """In the open profile whoever dials the observers' port hears the truth."""
    for keys_folder in (None, secure.keys):
        folder = tmp_path / ("secure" if keys_folder else "open")
        folder.mkdir()
        profile = Profile(keys_folder)
        with running_team(small_scenario(COUNT), folder, keys_folder=keys_folder) as team:
            team.wait_for_block(1)
            tls = tls_settings(profile.credentials("r1"))
            with raw_session([team.plan.server.observe], tls=tls) as session:
                heard: set[str] = set()
                kept = [
                    session.declare_subscriber(key, lambda sample, heard=heard: heard.add(str(sample.key_expr)))
                    for key in ("**", f"{team.keys.run}/observe/server/*")
                ]
                if keys_folder is None:
                    wait_until(lambda heard=heard: team.keys.observe_server("truth") in heard, "the truth")
                team.wait_for_block(team.ask(StatusRequest()).block + 100)
                if keys_folder is not None:
                    assert heard == set()
                    assert "refused from r1: it dialled an endpoint that only observer, oper" in team.log("server")
                assert len(kept) == 2


def memory(team: Team, name: str) -> float:
    """Resident memory of a process [MiB]."""
    pages = Path(f"/proc/{team.processes[name].pid}/statm").read_text().split()[1]
    return int(pages) * os.sysconf("SC_PAGE_SIZE") / 2**20


def flood(team: Team, session: zenoh.Session, size: int) -> dict[str, float]:
    """At least 10 MiB of messages of so many bytes in r2's name to r1; the memory of all processes meanwhile [MiB]."""
    key, stop, said = team.keys.agent("r2", "block"), threading.Event(), list[int]()

    def speak() -> None:
        rubbish = os.urandom(size)
        while not stop.is_set():
            session.put(key, rubbish, congestion_control=zenoh.CongestionControl.BLOCK)
            said.append(size)

    thread = threading.Thread(target=speak)
    thread.start()
    try:
        team.wait_for_block(team.ask(StatusRequest()).block + 100)
        wait_until(lambda: sum(said) > 10 * 2**20, "the flood")
        return {name: memory(team, name) for name in team.processes}
    finally:
        stop.set()
        thread.join()


@pytest.mark.skipif(not Path("/proc/self/statm").exists(), reason="the system does not tell a process's memory")
def test_a_neighbour_that_floods_fills_no_memory_and_no_disk_and_disturbs_no_other_robot(secure, tmp_path):
    with running_team(small_scenario(COUNT, "line"), tmp_path, "realtime", keys_folder=secure.keys) as team:
        team.wait_for_block(50)
        began = time.monotonic()
        before = {name: memory(team, name) for name in team.processes}
        with raw_session([team.plan.agents["r1"].listen], tls=tls_settings(secure.credentials("r2"))) as session:
            for size in (1_000_000, 200_000, 1_000):  # the first is too large to be read at all
                during = flood(team, session, size)
                for name in team.processes:
                    # Links have buffers, which are the fuller the busier the machine is.
                    assert during[name] - before[name] < 60.0, (size, name, before, during)
                assert ("refused from r2" in team.log("r1")) == (size < 2**18)
        team.wait_for_block(team.ask(StatusRequest()).block + 50)
        assert len(team.log("r1").splitlines()) < 2 * BURST + RATE * (time.monotonic() - began)
        lines = [line for name in ("r2", "r3", "r4") for line in team.log(name).splitlines() if "refused" in line]
        assert [line for line in lines if "blocks ahead" not in line] == []  # a busy machine may leave a robot behind
        team.ask(StopRequest())
        assert team.exit_status("server") == 0


def test_messages_of_an_old_run_change_nothing_in_a_new_one(secure, tmp_path):
    """The same team with the same certificates: what r2 once said to r1 is said to r1 again, by somebody with r2's."""
    scenario, recorded = small_scenario(COUNT, "line"), list[bytes]()
    (tmp_path / "old").mkdir()
    with running_team(scenario, tmp_path / "old", keys_folder=secure.keys) as team:
        team.wait_for_block(1)
        old = team.keys.agent("r2", "block")
        with (
            raw_session([team.plan.agents["r2"].listen], tls=tls_settings(secure.credentials("r1"))) as session,
            session.declare_subscriber(
                f"{old.rpartition('/')[0]}/*", lambda sample: recorded.append(sample.payload.to_bytes())
            ),
        ):
            wait_until(lambda: len(recorded) >= 100, "messages")
    (tmp_path / "new").mkdir()
    with running_team(scenario, tmp_path / "new", keys_folder=secure.keys) as team:
        team.wait_for_block(1)
        new = team.keys.agent("r2", "block")
        with raw_session([team.plan.agents["r1"].listen], tls=tls_settings(secure.credentials("r2"))) as session:
            publisher = session.declare_publisher(new, congestion_control=zenoh.CongestionControl.BLOCK)
            wait_until(lambda: bool(publisher.matching_status.matching), "r1's ear")  # type: ignore[attr-defined]
            for payload in recorded[:20]:
                session.put(old, payload, congestion_control=zenoh.CongestionControl.BLOCK)
                publisher.put(payload)
            wait_until(lambda: len(team.refusals("r1")) >= 20, "refusals")
        team.wait_for_block(team.ask(StatusRequest()).block + 50)
        # Those under the old key have not even arrived.
        refusals = team.refusals("r1")
        assert len(refusals) == 20
        for line in refusals:
            assert "refused from r2: not a NeighbourMessage: its checksum is wrong" in line
        team.ask(StopRequest())
        assert [team.exit_status(name) for name in team.processes] == [0] * (COUNT + 1)


@pytest.mark.parametrize("room", [backlog_module.ROOM, 2**40], ids=["bounded", "without bound"])
def test_what_no_process_reads_is_bounded_and_does_not_keep_others_waiting(room, monkeypatch):
    """Without the bound all of it is kept: so this can fail."""
    monkeypatch.setattr(backlog_module, "ROOM", room)
    keys, endpoint, size, count = Keys("run"), f"tcp/127.0.0.1:{free_port()}", 100_000, 400
    inbox, witness = Inbox(), Inbox()
    with open_session([endpoint]) as near, open_session(connect=[endpoint]) as far:
        inbox.listen(near, "r2", {keys.agent("r2", "block"): Hello})
        witness.listen(near, "r3", {keys.agent("r3", "hello"): Hello})
        inbox.listen(near, "r3", {keys.agent("r3", "hello"): Hello, keys.agent("r3", "ready"): Ready})
        flood = far.declare_publisher(keys.agent("r2", "block"), congestion_control=zenoh.CongestionControl.BLOCK)
        other = Sender(far, keys.agent("r3", "hello"), may_drop=False)
        wait_until(lambda: flood.matching_status.matching and other.has_listener, "the links")  # type: ignore[attr-defined]
        for _ in range(count):
            flood.put(bytes(size))
        for _ in range(2):
            other.send(Hello(sender="r3", heard=[]))
        for _ in range(2):  # all that was sent before the second has arrived
            assert isinstance(witness.receive(LIMIT), Received)
        events = list(iter(lambda: inbox.receive(0.0), None))
    assert any(isinstance(event, Received) and event.source == "r3" for event in events[:3])
    refused = [event for event in events if isinstance(event, Refused)]
    if room == backlog_module.ROOM < 2**40:
        assert "messages are lost" in str(refused[0].error)
        assert size * (len(refused) - 1) <= room
    else:
        assert len(refused) == count


def test_keys_are_secret_and_never_overwritten(secure):
    assert secure.keys is not None
    names = {"authority", "server", "observer", "operator", "r1", "r2", "r3", "r4"}
    assert (
        {path.stem for path in secure.keys.glob("*.crt")} == {path.stem for path in secure.keys.glob("*.key")} == names
    )
    for path in secure.keys.glob("*.key"):
        assert stat.S_IMODE(path.stat().st_mode) == 0o600
    before = {path: path.read_bytes() for path in secure.keys.iterdir()}
    with pytest.raises(CoheftError, match="never overwritten"):
        make_keys(secure.keys, small_scenario(COUNT))
    assert {path: path.read_bytes() for path in secure.keys.iterdir()} == before


def test_who_needs_no_more_certificates_keeps_no_key_that_could_make_them(tmp_path):
    make_keys(tmp_path / "keys", small_scenario(COUNT), keeps_authority=False)
    check_keys(tmp_path / "keys", small_scenario(COUNT))
    assert not list(tmp_path.rglob("authority.key"))
    with pytest.raises(CoheftError, match="never overwritten"):
        make_keys(tmp_path / "keys", small_scenario(COUNT), keeps_authority=False)


def test_a_plan_gives_every_host_consecutive_ports(secure):
    hosts = Hosts({"server": "10.0.0.1", "r1": "10.0.0.2", "r2": "fd00::2", "r3": "robot3.local"}, port=30000)
    plan = make_plan(small_scenario(COUNT), hosts=hosts, keys=secure.keys)
    assert plan.server.observe == "tls/10.0.0.1:30000"
    assert list(plan.server.robots.values()) == [f"tls/10.0.0.1:{port}" for port in range(30001, 30005)]
    assert plan.agents["r2"].listen == "tls/[fd00::2]:30000"
    assert plan.agents["r3"].observe == "tls/robot3.local:30001"
    # r4 is not named: it is where the server is.
    assert plan.agents["r4"].listen == "tls/10.0.0.1:30005"
    assert plan.agents["r1"].server == plan.server.robots["r1"]


def test_parts_are_not_spread_over_hosts_in_the_open_profile():
    make_plan(small_scenario(COUNT), hosts=Hosts({"server": "127.0.0.1", "r1": "127.0.0.2"}))
    with pytest.raises(CoheftError, match="add --secure"):
        make_plan(small_scenario(COUNT), hosts=Hosts({"r1": "10.0.0.2"}))


@pytest.mark.parametrize(
    ("text", "what"),
    [
        ("hosts = 3", "key 'hosts': expected a text under each name; found 3"),
        ("[hosts]\nr9 = '10.0.0.1'", "key 'hosts.r9': no such part; available: server, r1"),
        ("port = 0\n[hosts]", "port"),
        ("[hosts]\nr2 = '10.0.0.2'", "server is on 127.0.0.1, which other hosts cannot reach"),
        ("[host]", "host"),
        ("[hosts", "not valid TOML"),
    ],
)
def test_a_table_of_hosts_that_cannot_be_used_is_explained(text, what, tmp_path):
    path = tmp_path / "hosts.toml"
    path.write_text(text)
    with pytest.raises(ScenarioError, match=what) as error:
        load_hosts(path, small_scenario(COUNT))
    assert str(path) in str(error.value)


def test_keys_that_would_open_nothing_are_refused_before_the_run(secure, tmp_path):
    scenario = small_scenario(COUNT)
    check_keys(secure.keys, scenario)
    with pytest.raises(CoheftError, match=r"r1.crt is not for 10.0.0.2, where r1 runs"):
        check_keys(secure.keys, scenario, Hosts({"r1": "10.0.0.2", "server": "127.0.0.1"}))
    with pytest.raises(CoheftError, match=r"keys contains no r5.crt and no r5.key"):
        check_keys(secure.keys, small_scenario(COUNT + 1))
    make_keys(tmp_path / "old", scenario, lifetime=timedelta(seconds=-1))
    with pytest.raises(CoheftError, match=r"authority.crt has expired on .* UTC"):
        check_keys(tmp_path / "old", scenario)


def test_keys_of_another_clock_are_refused_before_the_run(tmp_path, monkeypatch):
    monkeypatch.setattr("coheft.app.run.keys.CLOCK_TOLERANCE", timedelta(hours=-1))
    make_keys(tmp_path / "early", small_scenario(COUNT))
    with pytest.raises(
        CoheftError, match=r"authority.crt is valid from .* UTC on, but it is .* UTC here: set the clock"
    ):
        check_keys(tmp_path / "early", small_scenario(COUNT))


@pytest.mark.parametrize(
    ("taken", "name", "complaint"),
    [
        ("other/r2.*", "r2", r"keys/r2.crt is signed by another authority than .*keys/authority.crt: take all files"),
        ("other/operator.*", "operator", r"operator.crt is signed by another authority"),
        ("other/authority.crt", "authority", r"server.crt is signed by another authority"),
        ("other/r2.key", "r2", r"keys/r2.key is not the key of .*keys/r2.crt: take both from one folder"),
        ("keys/r3.*", "r2", r"keys/r2.crt is a certificate of CN=r3, expected CN=r2"),
        ("old/r2.*", "r2", r"keys/r2.crt has expired on .* UTC: make new keys in another folder"),
        ("broken/it.key", "r2", r"keys/r2.key is not a key made by 'coheft keys'"),
        ("broken/it.crt", "r2", r"keys/r2.crt is not a certificate made by 'coheft keys'"),
    ],
)
def test_files_that_do_not_fit_together_are_refused_before_the_run(taken, name, complaint, secure, tmp_path):
    """Each would be found out by links that do not come, after a minute."""
    make_keys(tmp_path / "other", small_scenario(COUNT))
    authority_in(secure.keys).issue(tmp_path / "old", "r2", lifetime=timedelta(seconds=-1))
    (tmp_path / "broken").mkdir()
    for suffix in (".crt", ".key"):
        (tmp_path / "broken" / f"it{suffix}").write_text("rubbish")
    for path in tmp_path.glob(taken):
        shutil.copy(path, secure.keys / f"{name}{path.suffix}")
    with pytest.raises(CoheftError, match=complaint):
        check_keys(secure.keys, small_scenario(COUNT))


def test_the_command_line_makes_keys_and_runs_with_them(tmp_path):
    assert run_command_line(["keys", str(tmp_path / "keys"), "ring3", "--days", "2"]) == EXIT_CONVERGED
    certificate = x509.load_pem_x509_certificate((tmp_path / "keys" / "r1.crt").read_bytes())
    left = certificate.not_valid_after_utc - datetime.now(UTC)
    assert timedelta(days=1.9) < left <= timedelta(days=2)
    assert run_command_line(["keys", str(tmp_path / "keys"), "ring3"]) == EXIT_ERROR
    parts = tmp_path / "parts"
    command = ["run", "ring3", "--keys", str(tmp_path / "keys"), "--write-configs", str(parts)]
    assert run_command_line(command) == EXIT_CONVERGED
    config = msgspec.json.decode((parts / "r2.json").read_bytes(), type=AgentProcessConfig)
    assert config.security is not None
    assert config.security.key == "../keys/r2.key"
    command = ["run", "ring3", "--duration", "8", "--secure", "--logs", str(tmp_path / "run"), "--quiet"]
    assert run_command_line(command) == EXIT_CONVERGED
    assert (tmp_path / "run" / "keys" / "operator.key").exists()
