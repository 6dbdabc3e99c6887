"""Which records about robots are believed: in the secure profile those that the robot has signed itself."""

from __future__ import annotations

from pathlib import Path

import pytest
from msgspec.structs import replace

from coheft.agents.process.record_check import CLOCKS, RecordCheck, open_record_check
from coheft.app.run.keys import make_keys
from coheft.consensus.gossip import Gossip, is_newer
from coheft.errors import CoheftError
from coheft.wire.messages.limits import PER_MESSAGE
from coheft.wire.messages.structs import LinkState
from coheft.wire.transport.security import credentials_in
from coheft.wire.transport.signatures import Signatures
from tests.in_process import changed

NOW = 10**18
OF_R3 = LinkState("r3", 1, ("r1", "r2"), incarnation=NOW)


_VERSION = 12
"""Where a certificate has its version (DER)."""


@pytest.fixture(scope="module")
def keys(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("keys") / "team"
    make_keys(folder, changed("ring3"))
    return folder


def of(keys: Path, name: str, run: str = "run") -> RecordCheck:
    return RecordCheck(name, Signatures(run, credentials_in(keys, name)), clock=lambda: NOW)


def heard(by: RecordCheck, *records: LinkState) -> tuple[list[LinkState], list[str]]:
    problems: list[str] = []
    return by.believed(records, problems.append), problems


def test_what_a_robot_has_signed_is_believed_through_the_hands_of_others(keys: Path) -> None:
    (signed,) = of(keys, "r3").signed([OF_R3])
    believed, problems = heard(of(keys, "r1"), signed)
    assert (believed, problems) == ([signed], [])
    (handed_on,) = of(keys, "r1").signed([signed])
    assert heard(of(keys, "r2"), handed_on) == ([signed], [])


def test_what_comes_back_is_compared_with_what_was_said(keys: Path) -> None:
    own = of(keys, "r3")
    believed, _ = heard(own, *own.signed([OF_R3]))
    assert believed == [OF_R3]


@pytest.mark.parametrize(
    "changes",
    [
        {"incarnation": 2**62 - 1},
        {"incarnation": NOW + 1},
        {"sequence": 2},
        {"neighbours": ("r1",)},
        {"ready_block": 0},
        {"holding": False},
        {"since": 7},
        {"team": 1},
        {"robot": "r2"},
        {"signature": b""},
        {"signature": b"0" * 70},
        {"certificate": b""},
        {"certificate": b"0" * 100_000},
    ],
)
def test_a_record_that_someone_has_changed_is_not_believed(keys: Path, changes: dict[str, object]) -> None:
    (signed,) = of(keys, "r3").signed([OF_R3])
    own = of(keys, "r1")
    believed, (problem,) = heard(own, replace(signed, **changes))
    assert believed == []
    assert "r3" in problem or "r2" in problem
    assert heard(own, signed) == ([signed], [])  # the true one is, afterwards


def test_a_certificate_that_no_parser_knows_is_not_believed(keys: Path) -> None:
    (signed,) = of(keys, "r3").signed([OF_R3])
    strange = bytearray(signed.certificate)
    strange[_VERSION] = 5
    believed, (problem,) = heard(of(keys, "r1"), replace(signed, certificate=bytes(strange)))
    assert believed == []
    assert problem == "its record of 'r3' cannot be trusted: its certificate is not one of r3"


def test_one_robot_cannot_sign_for_another(keys: Path) -> None:
    liar = of(keys, "r2")
    lie = replace(liar.signed([replace(OF_R3, robot="r2")])[0], robot="r3")
    assert heard(of(keys, "r1"), lie)[0] == []


def test_an_authority_of_someone_else_makes_no_robots(keys: Path, tmp_path: Path) -> None:
    make_keys(tmp_path / "others", changed("ring3"))
    (lie,) = of(tmp_path / "others", "r3").signed([OF_R3])
    assert heard(of(keys, "r1"), lie)[0] == []


def test_what_was_signed_in_another_run_does_not_hold(keys: Path) -> None:
    (old,) = of(keys, "r3", run="another").signed([OF_R3])
    assert heard(of(keys, "r1"), old)[0] == []


def test_each_record_is_checked_once_and_after_a_wrong_one_none_of_the_message(
    keys: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    checks: list[str] = []
    check = Signatures.problem

    def counted(self: Signatures, record: LinkState) -> str | None:
        checks.append(record.robot)
        return check(self, record)

    monkeypatch.setattr(Signatures, "problem", counted)
    signed, own = of(keys, "r3").signed([OF_R3])[0], of(keys, "r1")
    for _ in range(10):
        assert heard(own, signed)[0] == [signed]
    assert checks == ["r3"]
    late = of(keys, "r3").signed([replace(OF_R3, sequence=0)])[0]
    assert heard(own, late) == ([], [])
    assert checks == ["r3"]
    made_up = [LinkState(f"x{number}", 0, ("r1",)) for number in range(1000)]
    believed, problems = heard(own, *made_up)
    assert (believed, len(problems), len(checks)) == ([], 1, 2)


def test_keys_that_cannot_sign_are_named(tmp_path: Path) -> None:
    for name in ("r1.key", "r1.crt", "authority.crt"):
        (tmp_path / name).write_text("no key")
    with pytest.raises(CoheftError, match=r"r1\.crt and its key cannot sign"):
        open_record_check("r1", "run", credentials_in(tmp_path, "r1"))


# --- the open profile ---


def test_a_start_in_the_far_future_is_not_believed_in_the_open_profile_either() -> None:
    believed, (problem,) = heard(RecordCheck("r1", clock=lambda: NOW), replace(OF_R3, incarnation=2**62 - 1), OF_R3)
    assert believed == []
    assert "years" in problem


def test_a_robot_can_outbid_whatever_is_believed_of_it() -> None:
    """Its neighbours hear the largest number that they believe, then its answer, as soon as the clock has gone on."""
    time = NOW
    neighbour = RecordCheck("r1", clock=lambda: time)
    robot = Gossip("r3", ("r1", "r2"), NOW)
    for _ in range(100):
        lie = replace(OF_R3, sequence=99, incarnation=time + CLOCKS)
        assert heard(neighbour, lie)[0] == [lie]
        robot.hear([lie])
        time += 1
        assert heard(neighbour, robot.own)[0] == [robot.own]
        assert is_newer(robot.own, lie)


def test_of_a_message_no_more_records_are_looked_at_than_robots_send() -> None:
    many = [LinkState(f"x{number}", 0, ()) for number in range(5 * PER_MESSAGE)]
    assert len(heard(RecordCheck("r1"), *many)[0]) == PER_MESSAGE
