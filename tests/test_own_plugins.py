"""Estimators and motions of somebody's own: what cannot be used is explained."""

from __future__ import annotations

from pathlib import Path

import msgspec
import numpy as np
import pytest

from coheft.agents.agent import Agent
from coheft.app.run.overrides import override
from coheft.errors import PluginError, ScenarioError
from coheft.wire.config import agent_config
from coheft.wire.scenario.file import load_scenario, parse_scenario
from coheft.wire.scenario.motion import Motion
from coheft.wire.scenario.plugins import available
from coheft.wire.scenario.schema import Scenario
from tests.own_packages import write_package

ESTIMATOR = """
from coheft.agents.estimator import Belief
import numpy as np
class Mine:
    def __init__(self, config, gossip):
        self.gain = config.estimator_settings["gain"]
    def step(self, index, own, inbox):
        return {"gain": np.array([self.gain])}
    def fits(self, channels):
        return True
    def belief(self):
        return Belief("poses", False, None, {})
    def doubts(self):
        return ()
"""
MOTION = """
import numpy as np
class Mine:
    def __init__(self, config):
        self.config = config
    def reference(self, block):
        return np.full((self.config.block, 12), 0.5)
"""
TEXT = """
name = "own"
payload.boxes = [{{ mass = 1, size = [1, 1, 1] }}]
robots.perimeter = {{ count = 2, extent = [1, 1] }}
graph.kind = "line"
{}
"""


def agent(scenario: Scenario) -> Agent:
    return Agent(agent_config(scenario, "r1", ("r2",)))


def with_estimator(settings: dict[str, object] | None = None) -> Scenario:
    own = {"mine": {"gain": 1.0} if settings is None else settings}
    return msgspec.structs.replace(load_scenario("ring3"), estimator="mine", settings=own)


def test_own_ones_are_listed_and_made_with_their_settings(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    write_package(tmp_path, "good", ESTIMATOR, estimators="mine = good:Mine")
    write_package(tmp_path, "nice", MOTION, motions="still = nice:Mine")
    monkeypatch.syspath_prepend(tmp_path)
    assert available("estimator")[:2] == ["efficient", "fan2017"]
    assert "mine" in available("estimator")
    assert "still" in available("motion")
    text = 'estimator = "mine"\nmotion.own = "still"\nsettings.mine.gain = 3.0'
    made = agent(parse_scenario(TEXT.format(text), "own.toml"))
    outbox = made.step(0, None, [])
    np.testing.assert_array_equal(outbox.message.channels["gain"], [3.0])
    np.testing.assert_array_equal(outbox.reference.motion, np.full((10, 12), 0.5))


@pytest.mark.parametrize(
    ("code", "entry", "expected"),
    [
        ("import no_such_module", "bad:Mine", r"'mine', bad:Mine of bad, cannot be imported: ModuleNotFoundError: .*"),
        ("from coheft.wire.messages import Hello", "bad:Mine", r"cannot be imported: .*modules have moved"),
        ("1 / 0", "bad:Mine", r"cannot be imported: ZeroDivisionError: division by zero \(.*bad.py, line 1\)"),
        ("", "bad:Mine", r"cannot be imported: AttributeError: .*Mine"),
        (
            "Mine = 3",
            "bad:Mine",
            r"cannot be made from AgentConfig, Gossip, or not with .* \[settings.mine\]: TypeError",
        ),
        (ESTIMATOR.replace("gossip)", "gossip, more)"), "bad:Mine", r"TypeError: .*missing 1 required .* 'more'"),
        (
            ESTIMATOR.replace('"gain"', '"size"'),
            "bad:Mine",
            r"\[settings.mine\]: KeyError: 'size' \(.*bad.py, line 6\)",
        ),
        (ESTIMATOR.replace("doubts", "questions"), "bad:Mine", r"a Mine, has no method doubts\(\); see docs/own.md"),
        (
            ESTIMATOR.replace("own, inbox", "own"),
            "bad:Mine",
            r"its method step\(index, own\) cannot be called as step\(index, own, inbox\)",
        ),
    ],
)
def test_estimators_that_do_not_fit(
    code: str, entry: str, expected: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    write_package(tmp_path, "bad", code, estimators=f"mine = {entry}")
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.delitem(__import__("sys").modules, "bad", raising=False)
    with pytest.raises(PluginError, match=expected):
        agent(with_estimator())


@pytest.mark.parametrize(
    ("code", "expected"),
    [
        (MOTION.replace("12)", "6)"), r"its reference for block 0 has the shape \(10, 6\), expected"),
        (MOTION.replace("np.full", "np.fill"), "returned no reference for block 0: AttributeError"),
        (MOTION.replace("reference", "refer"), r"has no method reference\(block\)"),
    ],
)
def test_motions_that_do_not_fit(code: str, expected: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    write_package(tmp_path, "bad", code, motions="mine = bad:Mine")
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.delitem(__import__("sys").modules, "bad", raising=False)
    with pytest.raises(PluginError, match=expected):
        agent(msgspec.structs.replace(load_scenario("ring3"), motion=Motion(own="mine")))


def test_a_compiled_method_need_not_tell_its_arguments(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    code = ESTIMATOR + "\nMine.fits = max\n"  # a function of C
    write_package(tmp_path, "compiled", code, estimators="mine = compiled:Mine")
    monkeypatch.syspath_prepend(tmp_path)
    assert agent(with_estimator()).step(0, None, []).message.channels


def test_a_motion_that_fails_in_mid_run_is_told_with_its_place(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    code = MOTION.replace("0.5)", "0.5 if block < 6 else [1, 2])")
    write_package(tmp_path, "bad", code, motions="mine = bad:Mine")
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.delitem(__import__("sys").modules, "bad", raising=False)
    moved = agent(msgspec.structs.replace(load_scenario("ring3"), motion=Motion(own="mine")))
    moved.step(0, None, [])
    moved.step(1, None, [])
    said = r"the motion 'mine' of r1 returned no reference for block 6: ValueError: .*broadcast.* \(.*bad.py, line 7\)"
    with pytest.raises(PluginError, match=said):
        moved.step(2, None, [])


def test_a_name_that_two_packages_offer(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for package in ("one", "two"):
        write_package(tmp_path, package, ESTIMATOR, estimators=f"mine = {package}:Mine")
    monkeypatch.syspath_prepend(tmp_path)
    with pytest.raises(PluginError, match=r"several packages offer the estimator 'mine': .*two \(two:Mine\).* but one"):
        agent(with_estimator())


@pytest.mark.parametrize(
    ("keys", "expected"),
    [
        ('estimator = "mine"', "key 'estimator': found 'mine', expected one of: efficient, fan2017"),
        (
            'estimator = "eficient"',
            "there. Did you mean 'efficient'? Your own must be installed first, see docs/own.md",
        ),
        ('motion.own = "mine"', "key 'motion.own': found 'mine', expected one of: "),
        ('motion.own = "shaking"', ". Did you mean 'shaken'? Your own must be installed first"),
        (
            "settings.mine.a = 1",
            "key 'settings.mine': there is no such estimator or motion. There are: efficient, fan2017",
        ),
        (
            "settings.eficient.a = 1",
            "no such estimator or motion. Did you mean 'efficient'? There are: efficient, fan2017",
        ),
        (
            "settings.efficient.memory = 1",
            "key 'settings.efficient': these tables are for estimators and motions of your own; settings of "
            "'efficient' go under [efficient]",
        ),
        ('estimator = "fan2017"\nsettings.fan2017.rounds = 9', "settings of 'fan2017' go under [fan2017]"),
        (
            "settings.there.a = 1",
            "key 'settings.there': found settings of what this scenario does not use: its estimator is 'efficient', "
            'and it names no motion of your own. Leave them out, or add estimator = "there"',
        ),
        (
            'estimator = "there"\nmotion.own = "swinging"\n[settings.there]\n[settings.shaken]',
            "its estimator is 'there', and it names the motion 'swinging'. Leave them out, or add motion.own = "
            '"shaken"',
        ),
        ("settings.there.a = [1, 2024-01-01]", "key 'settings.there.a[1]': expected a number of 64 bits, text"),
        ("settings.seed.a = inf", "key 'settings.seed.a': expected a finite number"),
        ('motion = { own = "x", via_points = {} }', "found both 'via_points' and 'own'"),
    ],
)
def test_scenarios_that_ask_for_what_is_not_there(
    keys: str, expected: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    motions = "shaken = there:Mine\nswinging = there:Mine"
    write_package(tmp_path, "there", ESTIMATOR, estimators="there = there:Mine", motions=motions)
    monkeypatch.syspath_prepend(tmp_path)
    with pytest.raises(ScenarioError) as error:
        parse_scenario(TEXT.format(keys), "own.toml")
    assert expected in str(error.value)


def test_settings_of_the_estimator_that_a_scenario_names_may_stay_when_a_run_uses_another(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    write_package(tmp_path, "there", ESTIMATOR, estimators="there = there:Mine")
    monkeypatch.syspath_prepend(tmp_path)
    scenario = parse_scenario(TEXT.format('estimator = "there"\nsettings.there.gain = 2'), "own.toml")
    assert override(scenario, estimator="fan2017").estimator == "fan2017"
