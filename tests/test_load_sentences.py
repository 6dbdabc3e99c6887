"""The sentences of the report about changes of the load."""

from __future__ import annotations

from collections.abc import Mapping

import msgspec
import pytest

from coheft.app.results.report import LoadChangeReport
from coheft.app.terminal.load_sentences import load_change_sentences
from coheft.wire.messages.structs import Validity
from tests.synthetic_run import built_report, changing_run, recorded

ROBOTS = ("r1", "r2", "r3")


@pytest.fixture(scope="module")
def change() -> LoadChangeReport:
    """A change at 2 s that no robot noticed, though all knew the load."""
    found = built_report(recorded(*changing_run(dict.fromkeys(ROBOTS, 10**6), {}))).load_changes[0]
    assert (found.noticed_at_s, found.detected_at_s) == ({}, None)
    return found


def at(
    change: LoadChangeReport, at_s: float, noticed: Mapping[str, float], stale: tuple[str, ...] = ()
) -> LoadChangeReport:
    """The same at another time, noticed by some robots, while others were stale."""
    before = {
        name: msgspec.structs.replace(robot, status=Validity.STALE if name in stale else Validity.VALID)
        for name, robot in change.before_change.items()
    }
    detected = max(noticed.values()) if len(noticed) == len(ROBOTS) else None
    return msgspec.structs.replace(
        change, at_s=at_s, noticed_at_s=dict(noticed), detected_at_s=detected, before_change=before
    )


def noticed(*changes: LoadChangeReport) -> list[str]:
    """What is said of who noticed each change."""
    return [text.partition("kg. ")[2].partition(". ")[0] for text in load_change_sentences(changes)]


def test_two_changes_may_be_noticed_as_one(change: LoadChangeReport) -> None:
    both = at(change, 2.0, {}), at(change, 2.02, dict.fromkeys(ROBOTS, 2.12))
    assert noticed(*both) == [
        "All robots noticed this and the change at 2.02 s as one",
        "The last robot noticed after 0.1 s",
    ]


def test_a_change_that_was_not_noticed_for_long_is_not_one_with_the_next(change: LoadChangeReport) -> None:
    assert noticed(at(change, 2.0, {}), at(change, 4.0, dict.fromkeys(ROBOTS, 4.1)))[0] == "No robot noticed"


def test_while_robots_are_still_stale_they_notice_no_further_change(change: LoadChangeReport) -> None:
    both = at(change, 2.0, dict.fromkeys(ROBOTS, 2.1)), at(change, 2.3, {}, stale=ROBOTS)
    assert noticed(*both)[1] == "All robots were still stale, and noticed no further change"


def test_each_robot_is_named_if_they_differ(change: LoadChangeReport) -> None:
    both = at(change, 2.0, {"r1": 2.03}), at(change, 2.04, {"r2": 2.14}, stale=("r1",))
    assert noticed(*both) == [
        "r1 noticed after 0.0 s; r2 noticed this and the change at 2.04 s as one; r3 did not notice",
        "r2 noticed after 0.1 s; r1 was still stale, and noticed no further change; r3 did not notice",
    ]


def test_the_report_says_who_noticed_when() -> None:
    truths, estimates = changing_run(dict.fromkeys(ROBOTS, 110), {"r1": 2.06, "r3": 2.1})
    (found,) = built_report(recorded(truths, estimates)).load_changes
    assert found.noticed_at_s == {"r1": 2.06, "r3": 2.1}
    assert found.detected_at_s is None
    assert noticed(found) == ["r1, r3 noticed after 0.1 s; r2 did not notice"]
