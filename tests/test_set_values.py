"""Values of a scenario that are given on the command line."""

from __future__ import annotations

from typing import Any

import pytest

from coheft.app.study.random_team import random_team
from coheft.errors import ScenarioError
from coheft.wire.scenario.file import load_scenario
from coheft.wire.scenario.set_values import set_values, varied_values


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("a=3", {"a": 3}),
        ("a = 3.5", {"a": 3.5}),
        ("a=-1e-3", {"a": -1e-3}),
        ("a=true", {"a": True}),
        ("a=tree", {"a": "tree"}),
        ("a=models/shelf.xml", {"a": "models/shelf.xml"}),
        ('a="x = y"', {"a": "x = y"}),
        ("a=[1, 2.5]", {"a": [1, 2.5]}),
        ("a={ mass = 3.0 }", {"a": {"mass": 3.0}}),
        ("a.b.c=1", {"a": {"b": {"c": 1}}}),
    ],
)
def test_values_are_as_toml_has_them_and_names_need_no_quotes(text: str, expected: dict[str, Any]) -> None:
    table = dict[str, Any]()
    set_values(table, [text])
    assert table == expected


def test_values_take_the_place_of_others_in_order_and_leave_the_rest() -> None:
    table: dict[str, Any] = {"changes": [{"at": 1.0}, {"at": 2.0, "mass": 3.0}], "optional": None, "name": "x"}
    set_values(table, ["changes[1].at=5", "changes[1].at=6", "optional.inner=1"])
    assert table == {"changes": [{"at": 1.0}, {"at": 6, "mass": 3.0}], "optional": {"inner": 1}, "name": "x"}


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("a", "expected KEY=VALUE"),
        ("=3", "expected KEY=VALUE"),
        ("a..b=3", "expected KEY=VALUE"),
        (f"list[{'9' * 5000}]=3", "expected KEY=VALUE"),
        ("list.0=3", "key 'list': found '0' for a part of a list, expected a number in brackets, from [0]"),
        ("a=x y", "found 'x y', expected a value as TOML has it"),
        ("a=", "found '', expected a value"),
        ("a=[1", "expected a value as TOML has it"),
        ("list[2]=1", "key 'list': found number 2, but the list has 2, counted from 0"),
        ("lists[0].at=1", "key 'lists': found number 0 of a list that is not given, expected all of it: [...]"),
        ("inner.gains[1]=1", "key 'inner.gains': found number 1 of a list that is not given, expected all of it"),
        ("list.at=1", "key 'list': found 'at' for a part of a list, expected a number in brackets, from [0]"),
        ("inner[0]=1", "key 'inner': found 0 for a part of a section, expected a name"),
        ("inner.name.x=1", "key 'inner.name': found \"me\", which has no parts"),
    ],
)
def test_what_cannot_be_put_anywhere_is_refused(text: str, complaint: str) -> None:
    table: dict[str, Any] = {"list": [1, 2], "inner": {"name": "me"}}
    with pytest.raises(ScenarioError) as caught:
        set_values(table, [text])
    assert str(caught.value).startswith(f"--set {text}: ")
    assert complaint in str(caught.value)


def test_values_are_checked_like_those_of_the_file() -> None:
    scenario = load_scenario("ring6", ["sensors.tolerance.force_gain=0.01", "graph.kind=line", "load_changes[0].at=8"])
    assert scenario.sensors.tolerance.force_gain == 0.01
    assert scenario.graph.kind == "line"
    assert scenario.load_changes[0].at == 8.0
    with pytest.raises(ScenarioError, match=r"ring6.toml with --set sensors.block=1: key 'sensors.block': expected"):
        load_scenario("ring6", ["sensors.block=1"])


def test_teams_drawn_at_random_take_values_too() -> None:
    drawn, changed = random_team(7), random_team(7, ["sensors.noise_scale=3", "graph.kind=line"])
    assert changed.sensors.noise_scale == 3.0
    assert changed.graph.kind == "line"
    assert changed.robots == drawn.robots
    with pytest.raises(ScenarioError, match=r"random-7 with --set graph.kind=none: key 'graph.kind': expected one of"):
        random_team(7, ["graph.kind=none"])


def test_commas_divide_values_but_not_their_parts() -> None:
    assert varied_values("a.b=1, 2.5,x") == ["a.b=1", "a.b=2.5", "a.b=x"]
    assert varied_values("a=[1,[2,3]],{ b = 1, c = 2 }") == ["a=[1,[2,3]]", "a={ b = 1, c = 2 }"]
    assert varied_values("a=\"x,y\",'z'") == ['a="x,y"', "a='z'"]
