"""What an agent says of itself: valid only beyond doubt, and afterwards what was valid last, with the reasons."""

from __future__ import annotations

from types import MappingProxyType

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from coheft.agents.estimator import Belief
from coheft.agents.status import StatusKeeper
from coheft.estimation.geometry.spatial import Pose
from coheft.estimation.geometry.uncertain_pose import UncertainPose
from coheft.wire.config import agent_config
from coheft.wire.messages.structs import LoadChangeNotice, PayloadEstimate
from tests.in_process import changed

SCENARIO = changed("ring3")
EVERY = round(0.1 / SCENARIO.block_duration)
DOUBTS = ["r2 is silent since 1.00 s", "no complete sum"]


def keeper(name: str = "r1") -> StatusKeeper:
    return StatusKeeper(agent_config(SCENARIO, name, tuple(n for n in SCENARIO.robot_names if n != name)))


def belief(block: int, *, known: bool = True, changes: int = 0, unobservable: tuple[str, ...] = ()) -> Belief:
    """A belief from that block: all its numbers tell which."""
    payload = PayloadEstimate(float(block), np.full(3, block), block * np.eye(3), np.eye(10))
    pose = UncertainPose(Pose(np.eye(3), np.full(3, block)), np.eye(6))
    return Belief(
        phase="inertia",
        converged=True,
        payload=payload if known else None,
        poses=MappingProxyType({"r2": pose}),
        total_block=block,
        not_observable=unobservable,
        load_changes=tuple(LoadChangeNotice(0.1 * k, 0.1 * k) for k in range(changes)),
        learned_block=block,
    )


def test_it_starts_and_is_valid_once_nothing_speaks_against_it() -> None:
    status = keeper()
    first = status.report(0, belief(0), DOUBTS, 0)
    assert (first.status, first.reasons) == ("starting", DOUBTS)
    second = status.report(1, belief(1, known=False), [], 3)
    assert (second.status, second.reasons) == ("starting", ["too few samples of this load"])
    third = status.report(2, belief(2, known=False, unobservable=("mass: move",)), [], 3)
    assert (third.status, third.reasons) == ("starting", ["mass: move"])
    fourth = status.report(3, belief(3), [], 3)
    assert (fourth.status, fourth.reasons, fourth.valid_block, fourth.members) == ("valid", [], 3, 3)


def test_while_stale_it_tells_what_was_valid_last_and_what_it_knows_besides() -> None:
    status = keeper()
    status.report(5, belief(4), [], 3)
    status.problems = 7
    stale = status.report(20, belief(18, changes=2), DOUBTS, 2)
    assert stale.status == "stale"
    assert stale.reasons == DOUBTS
    assert stale.payload is not None
    assert stale.payload.mass == 4.0
    assert stale.poses["r2"].translation[0] == 4.0
    assert (stale.valid_block, stale.total_block) == (4, 4)
    assert (stale.block, stale.members, stale.problems, len(stale.load_changes)) == (20, 2, 7, 2)
    again = status.report(30, belief(29), [], 3)
    assert (again.status, again.reasons, again.valid_block) == ("valid", [], 29)


@given(st.lists(st.tuples(st.booleans(), st.booleans()), max_size=30))
def test_valid_means_beyond_doubt_and_stale_that_it_was_once(story: list[tuple[bool, bool]]) -> None:
    status = keeper()
    last_valid = None
    for block, (is_doubted, is_known) in enumerate(story):
        said = status.report(block, belief(block, known=is_known), DOUBTS if is_doubted else [], 3)
        if is_known and not is_doubted:
            last_valid = block
            assert said.status == "valid"
        else:
            assert said.status == ("starting" if last_valid is None else "stale")
        assert (said.reasons == []) == (said.status == "valid")
        if last_valid is not None:
            assert said.valid_block == last_valid
            assert said.payload is not None
            assert said.payload.mass == float(last_valid)


@given(st.integers(0, 1000), st.lists(st.booleans(), min_size=1, max_size=60))
def test_all_report_at_the_same_blocks_and_at_once_when_doubts_come_or_go(first: int, doubts: list[bool]) -> None:
    """Whichever block they start at."""
    status = keeper()
    told = False
    for block, is_doubted in enumerate(doubts, first):
        words = DOUBTS if is_doubted else []
        is_regular = (block + 1) % EVERY == 0
        assert status.is_due(block, words) == (is_regular or is_doubted != told)
        if status.is_due(block, words):
            status.report(block, belief(block), words, 3)
            told = is_doubted
