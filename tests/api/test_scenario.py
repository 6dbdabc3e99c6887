"""Scenarios in Python have the checks of files."""

from __future__ import annotations

import msgspec
import pytest

import coheft
from coheft.errors import ScenarioError
from coheft.wire.scenario.file import available_scenarios
from coheft.wire.scenario.file import load_scenario as load_file

PLATE = coheft.Scenario(
    name="plate",
    payload=coheft.Payload(boxes=(coheft.Box(mass=6.0, size=(1.0, 0.6, 0.05)),)),
    robots=coheft.Robots(perimeter=coheft.Perimeter(count=4, extent=(1.0, 0.6))),
)


@pytest.mark.parametrize("name", available_scenarios())
def test_what_was_loaded_can_be_loaded_again(name):
    scenario = coheft.load_scenario(name)
    assert scenario == load_file(name)
    assert coheft.load_scenario(scenario) == scenario


def test_one_that_was_built_in_python_is_the_same_as_of_a_dictionary():
    table = {
        "name": "plate",
        "payload": {"boxes": [{"mass": 6.0, "size": [1.0, 0.6, 0.05]}]},
        "robots": {"perimeter": {"count": 4, "extent": [1.0, 0.6]}},
    }
    assert coheft.load_scenario(PLATE) == coheft.load_scenario(table)
    heavier = coheft.load_scenario(PLATE, set={"payload.boxes[0].mass": 7.0})
    assert heavier.payload.boxes[0].mass == 7.0
    coheft.load_scenario(table, set={"payload.boxes[0].mass": 7.0})
    assert table["payload"]["boxes"][0]["mass"] == 6.0, "what the caller has stays as it is"


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        (
            {"payload": coheft.Payload(boxes=(coheft.Box(mass=-6.0, size=(1.0, 0.6, 0.05)),))},
            "expected a number greater than 0; found -6.0",
        ),
        ({"sensors": coheft.Sensors(rate=300)}, "sensors.rate"),
        ({"load_changes": (coheft.LoadChange(at=99.0, mass=1.0),)}, "load_changes"),
        ({"robots": coheft.Robots(perimeter=coheft.Perimeter(count=1, extent=(1.0, 0.6)))}, "count"),
        ({"estimator": "eficient"}, "Did you mean 'efficient'"),
        ({"duration": object()}, "expected numbers, texts"),
    ],
)
def test_what_a_file_may_not_say_is_refused(changes, message):
    with pytest.raises(ScenarioError, match=message) as raised:
        coheft.load_scenario(msgspec.structs.replace(PLATE, **changes))
    assert str(raised.value).startswith("scenario 'plate'")


def test_keys_that_there_are_not_are_refused():
    with pytest.raises(ScenarioError, match="there is no such key"):
        coheft.load_scenario(PLATE, set={"sensors.noize": 2})
    with pytest.raises(ScenarioError, match=r"set=\{'sensors..rate': 200\}: found the key"):
        coheft.load_scenario(PLATE, set={"sensors..rate": 200})
