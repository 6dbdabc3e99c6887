"""The JSON schema of scenarios accepts all that are shipped, and refuses what coheft refuses by its types."""

from __future__ import annotations

import json
import tomllib
from pathlib import Path
from typing import Any

import pytest

from coheft.app.cli.main import run_command_line
from coheft.wire.scenario.file import available_scenarios
from coheft.wire.scenario.json_schema import scenario_schema

jsonschema = pytest.importorskip("jsonschema", reason="takes the package jsonschema")


def errors(table: dict[str, Any]) -> list[str]:
    validator = jsonschema.Draft202012Validator(scenario_schema())
    return [error.message for error in validator.iter_errors(table)]


@pytest.mark.parametrize("path", available_scenarios().values(), ids=lambda path: path.stem)
def test_shipped_scenarios_fit(path: Path) -> None:
    assert errors(tomllib.loads(path.read_text())) == []


@pytest.mark.parametrize(
    "wrong",
    [
        {"duration": -1},
        {"sensors": {"rate": 300}},
        {"sensors": {"rates": 100}},
        {"robots": {"grasps": [{"position": [0, 0]}]}},
        {"name": "Ring 3"},
    ],
    ids=str,
)
def test_what_is_wrong_is_found(wrong: dict[str, Any]) -> None:
    table = tomllib.loads(available_scenarios()["ring3"].read_text())
    assert errors(table | wrong)


def test_a_tolerance_is_said_to_be_one_standard_deviation_at_once() -> None:
    schema = scenario_schema()["$defs"]
    texts = [schema["SensorTolerance"]["description"]]
    texts += [schema[section]["properties"]["tolerance"]["description"] for section in ("Sensors", "OtherSensors")]
    assert all(text.startswith("One standard deviation of each ") for text in texts), texts


def test_every_key_is_explained(capfd: pytest.CaptureFixture[str]) -> None:
    assert run_command_line(["schema"]) == 0
    schema = json.loads(capfd.readouterr().out)
    for section in schema["$defs"].values():
        assert section["description"]
        for key, value in section["properties"].items():
            assert value.get("description"), f"{section['title']}.{key}"
            assert "\\Z" not in value.get("pattern", ""), "no expression of JavaScript"
