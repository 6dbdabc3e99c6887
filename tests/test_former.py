"""The paper's method by its former name."""

from __future__ import annotations

from typing import ClassVar

import msgspec
import numpy as np
import pytest

from coheft.app.run.overrides import override
from coheft.errors import ScenarioError
from coheft.wire.config import agent_config
from coheft.wire.messages.codec import decode, encode
from coheft.wire.messages.requests import EstimatorRequest
from coheft.wire.messages.structs import Measurements, Message
from coheft.wire.scenario.file import CONFIG_FOLDER, load_scenario, parse_scenario
from tests.synthetic_run import LIGHT, estimate

RING3 = CONFIG_FOLDER.joinpath("ring3.toml").read_text()


def test_the_paper_s_method_is_read_by_its_former_name_and_its_settings_are() -> None:
    scenario = parse_scenario(f'estimator = "seed"\n{RING3}\n[seed_method]\nrounds = 9\n', "old.toml")
    assert (scenario.estimator, scenario.fan2017.rounds) == ("fan2017", 9)
    assert load_scenario("line4", ["seed_method.rounds=64", "estimator=seed"]).fan2017.rounds == 64
    assert override(load_scenario("ring3"), estimator="seed") == override(load_scenario("ring3"), estimator="fan2017")
    config = agent_config(scenario, "r1", ("r2",))
    assert (config.estimator, config.fan2017) == ("fan2017", scenario.fan2017)


def test_a_setting_under_both_names_is_an_error() -> None:
    both = f"{RING3}\n[fan2017]\nrounds = 8\n[seed_method]\nrounds = 9\n"
    with pytest.raises(ScenarioError, match=r"key 'seed_method\.rounds': found it beside 'fan2017\.rounds'"):
        parse_scenario(both, "both.toml")
    with pytest.raises(ScenarioError, match=r"key 'fan2017': expected a section, written \[fan2017\]; found 3"):
        parse_scenario(f"seed_method = 3\n{RING3}", "three.toml")


class FormerRequest(Message, frozen=True):
    """What ``coheft use seed`` sent."""

    code: ClassVar[int] = EstimatorRequest.code

    estimator: str


def test_messages_of_former_releases_name_the_method_as_it_is_called_now() -> None:
    asked = decode(encode(FormerRequest(estimator="seed"), "key"), EstimatorRequest, "key")
    assert asked == EstimatorRequest(estimator="fan2017")
    said = estimate("r1", 3, LIGHT)
    assert msgspec.structs.replace(said, estimator="seed").estimator == "fan2017"
    measured = Measurements(robot="r1", block=3, samples=np.zeros((2, 15)), estimator="seed")
    assert measured.estimator == "fan2017"
