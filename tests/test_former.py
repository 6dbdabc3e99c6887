"""Names and files of version 345a219."""

from __future__ import annotations

from pathlib import Path
from typing import Any, ClassVar

import msgspec
import numpy as np
import pytest

from coheft.app.faults.draw import draw_schedule
from coheft.app.faults.schedule import read_schedule
from coheft.app.run.overrides import override
from coheft.errors import ScenarioError
from coheft.wire.config import agent_config
from coheft.wire.former_names import as_present
from coheft.wire.messages.codec import decode, encode
from coheft.wire.messages.requests import EstimatorRequest
from coheft.wire.messages.structs import Measurements, Message
from coheft.wire.scenario.file import CONFIG_FOLDER, load_scenario, parse_scenario
from tests.faults.drawn import plain
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
    with pytest.raises(ScenarioError, match=r"key 'seed_method\.rounds': found both this key and 'fan2017\.rounds'"):
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


FORMER_OFFSETS = {"gyro": 0.0, "velocity": 0.0, "acceleration": 0.3, "force": 3.0, "torque": 0.0}
FORMER_EFFICIENT = {"start_rotation_deg": 1.0, "start_translation_mm": 20.0, "refit_share": 0.05, "offsets": True}


def former_schedule(offsets: dict[str, float]) -> dict[str, Any]:
    """A schedule as 345a219 wrote it."""
    table: dict[str, Any] = msgspec.to_builtins(plain(3))
    sensors = table["scenario"]["sensors"]
    for key in ("errors", "tolerance", "drift", "noise_correlation", "of"):
        sensors.pop(key, None)
    sensors["offset"] = offsets
    table["scenario"]["efficient"] = FORMER_EFFICIENT | {"memory": "window"}
    table["scenario"]["seed_method"] = table["scenario"].pop("fan2017")
    table["scenario"]["estimator"] = "seed"
    return table


def test_a_schedule_of_345a219_is_read_and_is_judged(tmp_path: Path) -> None:
    path = tmp_path / "former.json"
    path.write_bytes(msgspec.json.encode(former_schedule(dict.fromkeys(FORMER_OFFSETS, 0.0))))
    read, drawn = read_schedule(path), plain(3)
    assert read.faults == drawn.faults
    assert read.scenario.estimator == "fan2017"
    assert read.scenario.sensors.errors == "none", "explicit errors would be undeclared, and not be judged"
    assert read.scenario.sensors.tolerance.force_offset == 1.2


def test_largest_offsets_of_345a219_become_standard_deviations() -> None:
    sensors = as_present(former_schedule(FORMER_OFFSETS)["scenario"], "former")["sensors"]
    assert sensors["errors"] == pytest.approx({"acceleration_offset": 0.3 / 3.0**0.5, "force_offset": 3.0 / 3.0**0.5})


def test_offsets_that_are_no_numbers_are_refused_by_name(tmp_path: Path) -> None:
    path = tmp_path / "former.json"
    path.write_bytes(msgspec.json.encode(former_schedule(FORMER_OFFSETS | {"force": "large"})))  # type: ignore[dict-item]
    with pytest.raises(ScenarioError, match=r"not a fault schedule: Expected `float`, got `str`.*force_offset"):
        read_schedule(path)


def test_scenarios_of_this_release_stay_as_they_are() -> None:
    scenario = msgspec.to_builtins(draw_schedule(3).scenario)
    assert as_present(scenario, "present") == scenario
