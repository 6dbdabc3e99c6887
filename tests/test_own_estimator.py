"""What an own estimator returns is checked in its own agent: real agents, all in one process."""

from __future__ import annotations

import re
import sys
from collections.abc import Callable
from pathlib import Path

import msgspec
import numpy as np
import pytest

from coheft.agents.agent import Agent
from coheft.app.run.inprocess import run_in_process
from coheft.errors import PluginError
from coheft.wire.config import agent_config
from coheft.wire.messages.codec import encode
from coheft.wire.messages.structs import Estimate, LoadChangeNotice
from coheft.wire.scenario.file import load_scenario
from coheft.wire.scenario.schema import Scenario
from tests.own_packages import write_package

HEAD = """
import numpy as np
from coheft.agents.estimator import Belief
from coheft.estimation.geometry.spatial import Pose
from coheft.estimation.geometry.uncertain_pose import UncertainPose
from coheft.wire.messages.structs import LoadChangeNotice, PayloadEstimate

class Mine:
    def __init__(self, config, gossip):
        self.name, self.gossip, self.sum = config.name, gossip, np.zeros(2)
"""
METHODS = {
    "step(self, index, own, inbox)": "return {}",
    "fits(self, channels)": "return True",
    "belief(self)": 'return Belief("poses", False, None, {})',
    "doubts(self)": "return ()",
}
Write = Callable[..., Scenario]


@pytest.fixture
def write(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Write:
    """Installs the estimator ``mine``, some of whose methods do something else, and makes three robots use it."""

    def write_it(**bodies: str) -> Scenario:
        code = HEAD
        for method, body in METHODS.items():
            code += f"    def {method}:\n        {bodies.get(method.partition('(')[0], body)}\n"
        write_package(tmp_path, "own_mine", code, estimators="mine = own_mine:Mine")
        monkeypatch.syspath_prepend(tmp_path)
        monkeypatch.delitem(sys.modules, "own_mine", raising=False)
        return msgspec.structs.replace(load_scenario("ring3"), estimator="mine", duration=0.4, load_changes=())

    return write_it


def refusal(scenario: Scenario) -> str:
    with pytest.raises(PluginError) as error:
        list(run_in_process(scenario))
    return str(error.value)


@pytest.mark.parametrize(
    ("returned", "said"),
    [
        ("None", "it is None, expected a dict of arrays by name; to send nothing, return {}"),
        ("[np.zeros(3)]", "it is a list, expected a dict of arrays by name"),
        ('{"a": [1.0]}', "the array 'a' is a list, expected an array: np.array(…) makes one"),
        ('{"a": np.sum(np.zeros(2))}', "the array 'a' is a float64, expected an array"),
        ("{1: np.zeros(3)}", "the name 1 of an array is a int, expected text"),
        ('{"a": np.array(["x"])}', "the array 'a' is an array of <U1, expected one of real numbers"),
        ('{"a": np.zeros(2, complex)}', "the array 'a' is an array of complex128, expected one of real numbers"),
        ('{"a": np.zeros(5 * (1,))}', "the array 'a' has 5 dimensions, expected at most 4: reshape it"),
        ('{"a": np.array([np.nan, 1, np.inf])}', "the array 'a' contains 2 numbers that are not finite"),
        ('{"a": np.array([1e12])}', "the array 'a' has a norm of at least 1e+12, expected a smaller one: use other"),
        ('{"a": np.zeros(40000)}', "its arrays take 320.0 kB, expected at most 184.0 kB, because neighbours drop"),
    ],
)
def test_what_neighbours_could_not_use_is_not_sent(returned: str, said: str, write: Write, tmp_path: Path) -> None:
    place = f"step ({tmp_path / 'own_mine.py'}, line 11) returned an unusable value: "
    text = refusal(write(step=f"return {returned}"))
    assert text.startswith(f"the estimator 'mine' of r1 at block 0 (0.00 s): {place}{said}")
    assert text.endswith(". See docs/own.md")


@pytest.mark.parametrize(
    ("method", "returned", "said"),
    [
        ("fits", "None", "it is None, expected True or False"),
        (
            "doubts",
            '"the sums have not begun"',
            "it is a str, expected a tuple, such as (one,), or ()",
        ),
        ("doubts", "(1,)", "it contains a int, expected texts"),
        ("belief", "None", "it is None, expected a Belief, see agents/estimator.py"),
        ("belief", 'Belief("weighing", False, None, {})', "phase is 'weighing' but expected one of 'poses', 'inertia'"),
        ("belief", "Belief(np.zeros(2), False, None, {})", "ValueError: The truth value of an array"),
        ("belief", 'Belief("poses", "no", None, {})', "converged is a str, expected True or False"),
        ("belief", 'Belief("poses", False, 3.0, {})', "payload is a float, expected a PayloadEstimate or None"),
        ("belief", 'Belief("poses", False, None, [])', "poses are a list, expected a dict by neighbours' names"),
        ("belief", 'Belief("poses", False, None, {"r9": 1})', "poses contain 'r9', expected neighbours only: r2"),
        ("belief", 'Belief("poses", False, None, {"r2": np.eye(4)})', "pose of 'r2' is a ndarray of the shape (4, 4)"),
        ("belief", 'Belief("poses", False, None, {}, total_block=999)', "total_block is 999, expected -1 for none"),
        (
            "belief",
            'Belief("poses", False, None, {}, learned_block=1.5)',
            "learned_block is a float, expected the numb",
        ),
        ("belief", 'Belief("poses", False, None, {}, total_wrench=np.zeros(3))', "total_wrench.shape is (3,) but"),
        (
            "belief",
            'Belief("poses", False, None, {}, not_observable="mass")',
            "not_observable is a str, expected a tup",
        ),
        (
            "belief",
            'Belief("poses", False, None, {}, load_changes=(3.0,))',
            "load_changes contains a float, expected a",
        ),
        (
            "belief",
            'Belief("poses", False, None, {}, load_changes=(LoadChangeNotice("now", 0.0),))',
            "noticed_at is the text 'now', expected a number",
        ),
    ],
)
def test_other_answers_are_checked_as_well(method: str, returned: str, said: str, write: Write) -> None:
    text = refusal(write(**{method: f"return {returned}"}))
    assert re.match(rf"the estimator 'mine' of r\d at block \d \(0\.\d\d s\): {method} \(.*own_mine\.py, line", text)
    assert f"returned an unusable value: {said}" in text


@pytest.mark.parametrize(
    ("payload", "said"),
    [
        ("[9.0], None, None, np.eye(1)", "mass is a list, expected a number"),
        ("10**400, None, None, np.eye(1)", "OverflowError: int too large to convert to float"),
        ("np.nan, None, None, np.eye(1)", "mass is nan but expected less than 1e+15"),
        ("9.0, None, None, [[1.0]]", "covariance of payload is a list, expected an array"),
        ("9.0, None, None, np.eye(10)", "covariance of payload.shape is (10, 10) but expected (1, 1)"),
        ("9.0, None, None, -np.eye(1)", "covariance of payload has a negative variance"),
        ("9.0, np.zeros((3, 1)), None, np.eye(4)", "com.shape is (3, 1) but expected (3,)"),
        ("9.0, None, np.eye(3), np.eye(10)", "com is missing but expected, because there is a tensor"),
        ("9.0, np.zeros(3), np.full((3, 3), np.inf), np.eye(10)", "tensor contains 9 numbers that are not finite"),
    ],
)
def test_what_is_believed_of_the_payload_can_be_computed_with(payload: str, said: str, write: Write) -> None:
    text = refusal(write(belief=f'return Belief("inertia", False, PayloadEstimate({payload}), {{}})'))
    assert f"returned an unusable value: {said}" in text


@pytest.mark.parametrize(
    ("pose", "said"),
    [
        (
            "UncertainPose(Pose(np.ones((3, 3)), np.zeros(3)), np.eye(6))",
            "rotation of 'r2' is not valid: expected an",
        ),
        ("UncertainPose(Pose(np.eye(3), np.zeros(2)), np.eye(6))", "translation of 'r2'.shape is (2,) but expected (3"),
        ("UncertainPose(Pose(np.eye(3), np.zeros(3)), np.eye(3))", "covariance of pose of 'r2'.shape is (3, 3) but ex"),
    ],
)
def test_what_is_believed_of_neighbours_can_be_computed_with(pose: str, said: str, write: Write) -> None:
    body = f'return Belief("poses", False, None, {{"r2": {pose}}} if self.name != "r2" else {{}})'
    assert f"returned an unusable value: {said}" in refusal(write(belief=body))


@pytest.mark.parametrize("announced", ["np.int64(3)", "-2"])
def test_what_it_has_gossip_announce_is_checked(announced: str, write: Write) -> None:
    text = refusal(write(step=f"self.gossip.announce_ready({announced}); return {{}}"))
    assert "returned an unusable value: it made Gossip announce an impossible record, expected what Link" in text


def test_an_exception_is_told_with_its_place_in_the_authors_file(write: Write, tmp_path: Path) -> None:
    scenario = write(step='return {} if self.name == "r1" or index < 7 else np.linalg.inv(np.zeros((2, 2)))')
    assert refusal(scenario) == (
        "the estimator 'mine' of r2 at block 7 (0.14 s): step raised LinAlgError: Singular matrix "
        f"({tmp_path / 'own_mine.py'}, line 12)"
    )


def test_numbers_of_numpy_lists_and_long_texts_will_do(write: Write) -> None:
    belief = """return Belief(
            "inertia", np.bool_(True), PayloadEstimate(np.float64(9.0), None, None, np.eye(1, dtype=int)), {},
            total_block=np.int64(-1), not_observable=["centre of mass"],
            load_changes=[LoadChangeNotice(np.float32(0.5), 1)],
        )"""
    scenario = write(belief=belief, doubts='return [999 * "x", "two\\nlines"] if self.gossip.graph is None else []')
    last: dict[str, Estimate] = {}
    for block in run_in_process(scenario):
        last |= block.estimates
        for estimate in block.estimates.values():
            encode(estimate, "key")
            assert all(len(reason) < 999 and reason.isprintable() for reason in estimate.reasons)
    assert [(each.status, each.converged, each.not_observable) for each in last.values()] == 3 * [
        ("valid", True, ["centre of mass"])
    ]
    assert last["r1"].load_changes == [LoadChangeNotice(0.5, 1.0)]


def test_what_was_sent_does_not_change_when_the_estimator_goes_on_with_its_array(write: Write) -> None:
    scenario = write(
        step='self.sum += 1; return {"sum": self.sum, "columns": np.asfortranarray(np.eye(2, 3, dtype=int))}'
    )
    agent = Agent(agent_config(scenario, "r1", ("r2",)))
    messages = [agent.step(index, None, []).message for index in range(3)]
    assert [message.channels["sum"].tolist() for message in messages] == [[1, 1], [2, 2], [3, 3]]
    columns = messages[0].channels["columns"]
    assert columns.dtype == np.float64  # as it arrives in another process
    assert columns.flags.c_contiguous
