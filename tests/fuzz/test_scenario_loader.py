"""Whatever a scenario file holds, it is refused with a ``ScenarioError``, or can be run."""

from __future__ import annotations

import json
import tomllib
from pathlib import Path
from typing import Any

import msgspec
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from coheft.app.run.overrides import override
from coheft.consensus.graph import build_graph
from coheft.errors import ScenarioError
from coheft.wire.config import AgentConfig, agent_config
from coheft.wire.scenario.file import available_scenarios, load_scenario, parse_scenario
from coheft.wire.scenario.schema import Scenario
from tests.fuzz.any_message import damaged, with_a_part_replaced

SHIPPED = [path.read_bytes() for path in available_scenarios().values()]
MAX_ROBOTS_LISTED = 24
"""Only the small ones are checked robot by robot: all edges of a large graph take their time."""

many = settings(max_examples=5 * settings.default.max_examples)


def check_usable(scenario: Scenario) -> None:
    """What is not refused can be given to every process of a run."""
    names = scenario.robot_names
    assert 2 <= len(names) == scenario.robot_count
    assert scenario.blocks >= 1
    assert msgspec.json.decode(msgspec.json.encode(scenario), type=Scenario) == scenario
    if len(names) <= MAX_ROBOTS_LISTED:
        graph = build_graph(scenario.graph, names)
        for name in names:
            config = agent_config(scenario, name, graph[name])
            assert msgspec.json.decode(msgspec.json.encode(config), type=AgentConfig) == config


def load_or_refuse(path: Path, data: bytes) -> None:
    path.write_bytes(data)
    refusal = None
    try:
        scenario = load_scenario(path)
    except ScenarioError as error:
        refusal = str(error)
    if refusal is None:
        check_usable(scenario)
    else:
        assert refusal.startswith(f"{path}: ")
        assert len(refusal) < len(str(path)) + 2000


@pytest.fixture(scope="module")
def path(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("scenarios") / "any.toml"


@many
@given(data=st.data())
def test_damaged_files(path: Path, data: st.DataObject) -> None:
    sound, other = data.draw(st.sampled_from(SHIPPED)), data.draw(st.sampled_from(SHIPPED))
    load_or_refuse(path, data.draw(damaged(sound, other)))


@many
@given(data=st.text(max_size=200).map(str.encode) | st.binary(max_size=200))
def test_any_file(path: Path, data: bytes) -> None:
    load_or_refuse(path, data)


@pytest.mark.parametrize(
    "text",
    [
        "a = " + 100_000 * "[",
        "a = " + 10_000 * "{ a = ",
        ".".join(5_000 * "a") + " = 1",
        "seed = " + 5_000 * "9",
        "seed = 0x" + 5_000 * "f",  # Python reads it, but cannot write it
        "estimator = 0x" + 5_000 * "f",
        "a = 9999-99-99",
        "duration = 1e400",
    ],
    ids=lambda text: text[:16],
)
def test_hostile_files(path: Path, text: str) -> None:
    load_or_refuse(path, text.encode())
    with pytest.raises(ScenarioError):
        parse_scenario(text + SHIPPED[0].decode(), "hostile")


_KEYS = st.text(max_size=8) | st.sampled_from(["mass", "remove", "count", "a.b[0]", "a` - at `$.b`", "a\nb"])
_LEAVES = (
    st.booleans()
    | st.integers(-(2**80), 2**80)
    | st.floats()
    | st.sampled_from([0, 1, -1, 2, 1e-300, 1e300, 5e-324, 1e7, 255, 256, 257, 2**32])
    | st.text(max_size=8)
    | st.dates()
    | st.datetimes()
    | st.times()
)
TABLES = st.recursive(
    _LEAVES,
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(_KEYS, inner, max_size=4),
    max_leaves=8,
)


def toml(value: Any) -> str:
    """Nested builtins as a TOML value."""
    match value:
        case bool():
            return str(value).lower()
        case int():
            return str(value)
        case float():
            return repr(value)
        case str():
            return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
        case list():
            return f"[{', '.join(map(toml, value))}]"
        case dict():
            return f"{{ {', '.join(f'{toml(key)} = {toml(inner)}' for key, inner in value.items())} }}"
        case _:
            return str(value.isoformat())


@many
@given(data=st.data())
def test_files_with_something_else_in_a_place(path: Path, data: st.DataObject) -> None:
    table = tomllib.loads(data.draw(st.sampled_from(SHIPPED)).decode())
    for _ in range(data.draw(st.integers(1, 3))):
        changed = data.draw(with_a_part_replaced(table, TABLES))
        table = changed if isinstance(changed, dict) else table
    text = "\n".join(f"{toml(key)} = {toml(value)}" for key, value in table.items())
    assert tomllib.loads(text).keys() == table.keys()  # it gets as far as the scenario's own checks
    load_or_refuse(path, text.encode())


_PARTS = st.builds(
    lambda key, value: f"{key}={value}",
    st.sampled_from(["t", "mass", "at", "size", "leak", "remove", "x", ""]),
    st.floats().map(repr) | st.integers().map(str) | st.sampled_from(["0.1,0.2,0.3", "1,2", "", "3 kg", "\0"]),
)


@many
@given(
    changes=st.lists(st.lists(_PARTS, max_size=5).map(",".join) | st.text(max_size=20), max_size=3),
    duration=st.none() | st.floats(),
    seed=st.none() | st.integers(),
    estimator=st.none() | st.sampled_from(["fan2017", "efficient"]) | st.text(max_size=8),
    sensor_rate=st.none() | st.integers(),
)
def test_command_line(
    changes: list[str], duration: float | None, seed: int | None, estimator: str | None, sensor_rate: int | None
) -> None:
    try:
        scenario = override(
            load_scenario("ring6"),
            changes=changes,
            duration=duration,
            seed=seed,
            estimator=estimator,
            sensor_rate=sensor_rate,
        )
    except ScenarioError:
        return
    check_usable(scenario)


@given(st.text(max_size=20) | st.text(max_size=8).map(lambda name: f"{name}.toml"))
def test_any_name(name: str) -> None:
    with pytest.raises(ScenarioError):
        load_scenario(f"missing/{name}")
