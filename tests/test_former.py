"""Files that former releases wrote."""

from __future__ import annotations

from pathlib import Path
from typing import ClassVar

import msgspec
import numpy as np
import pytest

from coheft.app.faults.draw import draw_schedule
from coheft.app.faults.schedule import read_schedule
from coheft.app.run.overrides import override
from coheft.app.run.plan import make_plan
from coheft.errors import ScenarioError
from coheft.wire.config import AgentProcessConfig, agent_config
from coheft.wire.former_names import decode_config
from coheft.wire.messages.codec import decode, encode
from coheft.wire.messages.requests import EstimatorRequest
from coheft.wire.messages.structs import Measurements, Message
from coheft.wire.scenario.file import CONFIG_FOLDER, load_scenario, parse_scenario
from coheft.wire.scenario.former import as_now
from tests.synthetic_run import LIGHT, estimate

SENSORS = {"rate": 100, "offset": {"gyro": 0.0, "acceleration": 0.3, "force": 3.0}}


def test_largest_offsets_become_standard_deviations() -> None:
    assert as_now({"sensors": SENSORS})["sensors"] == {
        "rate": 100,
        "errors": {
            "gyro_offset": 0.0,
            "acceleration_offset": pytest.approx(0.3 / 3.0**0.5),
            "force_offset": pytest.approx(3.0 / 3.0**0.5),
        },
    }


def test_settings_that_are_not_needed_are_left_out_and_those_that_robots_were_told_stay() -> None:
    former = {"efficient": {"start_rotation_deg": 1.0, "refit_share": 0.05, "offsets": True, "memory": 2.0}}
    now = as_now(former)
    assert now["efficient"] == {"memory": 2.0}
    assert now["sensors"]["tolerance"] == {"force_offset": 1.2, "torque_offset": 0.06}


def test_what_is_of_this_release_stays_as_it_is() -> None:
    scenario = msgspec.to_builtins(draw_schedule(3).scenario)
    assert as_now(scenario) == scenario


def test_a_schedule_of_a_former_release_is_read(tmp_path: Path) -> None:
    schedule = draw_schedule(3, is_exact=True)
    table = msgspec.to_builtins(schedule)
    del table["scenario"]["sensors"]["errors"]
    table["scenario"]["sensors"]["offset"] = dict.fromkeys(("gyro", "velocity", "acceleration", "force", "torque"), 0.0)
    table["scenario"]["efficient"] |= {"start_rotation_deg": 1.0, "start_translation_mm": 20.0, "offsets": False}
    path = tmp_path / "former.json"
    path.write_bytes(msgspec.json.encode(table))
    read = read_schedule(path)
    assert read.faults == schedule.faults
    assert read.scenario.sensor_errors == schedule.scenario.sensor_errors


RING3 = CONFIG_FOLDER.joinpath("ring3.toml").read_text()


def test_the_paper_s_method_is_read_by_its_former_name_and_its_settings_are() -> None:
    scenario = parse_scenario(f'estimator = "seed"\n{RING3}\n[seed_method]\nrounds = 9\n', "old.toml")
    assert (scenario.estimator, scenario.fan2017.rounds) == ("fan2017", 9)
    assert load_scenario("line4", ["seed_method.rounds=64", "estimator=seed"]).fan2017.rounds == 64
    assert override(load_scenario("ring3"), estimator="seed") == override(load_scenario("ring3"), estimator="fan2017")
    now = as_now({"estimator": "seed", "seed_method": {"rounds": 9}})
    assert now == {"estimator": "seed", "fan2017": {"rounds": 9}}, "the struct renames the estimator"
    config = agent_config(scenario, "r1", ("r2",))
    assert (config.estimator, config.seed_method) == ("fan2017", scenario.fan2017)


def test_the_configuration_of_an_agent_is_read_with_the_settings_former_name() -> None:
    scenario = load_scenario("ring3", ["estimator=fan2017", "fan2017.rounds=9"])
    written = make_plan(scenario).agents["r1"]
    table = msgspec.json.decode(msgspec.json.encode(written))
    former = table["agent"]
    former["estimator"], former["seed_method"] = "seed", former.pop("fan2017")
    assert decode_config(msgspec.json.encode(table), AgentProcessConfig) == written
    former["fan2017"] = {"rounds": 8}
    with pytest.raises(
        ScenarioError, match=r"the configuration of an agent: key 'seed_method\.rounds': found it beside"
    ):
        decode_config(msgspec.json.encode(table), AgentProcessConfig)
    with pytest.raises(msgspec.ValidationError, match="unknown field `best_method`"):
        decode_config(msgspec.json.encode({"agent": {"best_method": {}}}), AgentProcessConfig)


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
