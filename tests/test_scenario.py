"""Scenarios: the shipped ones load, and errors say where, what was found and what is allowed."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from coheft.app.run.hosts import load_hosts
from coheft.consensus.graph import build_graph
from coheft.errors import ScenarioError
from coheft.wire.config import agent_config
from coheft.wire.scenario.file import available_scenarios, load_scenario, parse_scenario
from docs import scenario_reference

GOOD = """
name = "two"
duration = 12.0
[payload]
boxes = [{ mass = 2.0, size = [0.4, 0.3, 0.1] }]
[[robots.grasps]]
position = [-0.2, 0.0, 0.0]
[[robots.grasps]]
position = [0.2, 0.0, 0.0]
[graph]
kind = "line"
[motion]
frequency = [0.4, 1.6]
[[load_changes]]
at = 5.0
mass = 1.0
"""


@pytest.mark.parametrize("name", list(available_scenarios()))
def test_shipped_scenarios_load(name: str) -> None:
    scenario = load_scenario(name)
    assert scenario.name == name
    assert scenario.description
    assert all(change.at < scenario.duration for change in scenario.load_changes)
    graph = build_graph(scenario.graph, scenario.robot_names)
    configs = [agent_config(scenario, robot, graph[robot]) for robot in graph]
    assert len({config.seed for config in configs}) == scenario.robot_count


def test_the_scenarios_that_are_promised_are_there() -> None:
    assert {"ring6", "ring3", "line4", "ring12", "ring24", "quiet"} <= set(available_scenarios())


@pytest.mark.parametrize(
    ("change", "match"),
    [
        (
            'estimator = "fan2017"\nfan2017 = { rounds = 256 }\nsensors = { block = 200 }\n',
            r"'sensors.block': found 200, and 'fan2017.rounds' = 256: .* up to 4.2 MB; expected at most 4.0 MB",
        ),
    ],
)
def test_messages_that_would_be_too_large_are_refused(change: str, match: str) -> None:
    robots = "" if "perimeter" in change else "[[robots.grasps]]" + GOOD.split("[[robots.grasps]]", 1)[1]
    payload = "[payload]\nboxes = [{ mass = 90.0, size = [1.4, 1.3, 0.1] }]\n"
    with pytest.raises(ScenarioError, match=match):
        parse_scenario(f'name = "large"\n{change}{payload}{robots}', "large.toml")
    smaller = change.replace("block = 200", "block = 20")
    assert parse_scenario(f'name = "large"\n{smaller}{payload}{robots}', "large.toml").sensors.block == 20


def test_more_robots_than_each_can_know_are_refused_and_the_other_method_is_named() -> None:
    team = 'name = "large"\npayload.boxes = [{ mass = 90.0, size = [1.4, 1.3, 0.1] }]\nrobots.perimeter.count = '
    text = f"{team}300\nrobots.perimeter.extent = [1.0, 1.0]\n"
    with pytest.raises(ScenarioError, match=r"'robots': found 300 .*, expected at most 128: .* With 'fan2017'"):
        parse_scenario(text, "large.toml")
    assert parse_scenario(f'estimator = "fan2017"\n{text}', "large.toml").robot_count == 300


def test_good_scenario_is_good() -> None:
    scenario = parse_scenario(GOOD, "two.toml")
    assert scenario.robot_names == ("r1", "r2")
    assert scenario.blocks == round(12.0 / scenario.block_duration)


@pytest.mark.parametrize(
    ("good", "bad", "key", "found", "allowed"),
    [
        ("mass = 2.0", "mass = -2.0", "payload.boxes[0].mass", "-2.0", "a number greater than 0"),
        ("mass = 2.0", "mass = nan", "payload.boxes[0].mass", "nan", "greater than 0"),
        ("mass = 2.0", "mass = inf", "payload.boxes[0].mass", "inf", "finite"),
        ("mass = 2.0", 'mass = "2 kg"', "payload.boxes[0].mass", '"2 kg"', "expected a number; found"),
        ("mass = 2.0", "mass = true", "payload.boxes[0].mass", "found true", "expected a number"),
        ("duration = 12.0", "duration = 2026-01-01", "duration", "found 2026-01-01", "expected a number"),
        ("mass = 2.0, ", "", "payload.boxes[0].mass", "missing", "required"),
        ("[-0.2, 0.0, 0.0]", "[-0.2, nan, 0.0]", "robots.grasps[0].position[1]", "nan", "finite"),
        ("[-0.2, 0.0, 0.0]", "[-0.2, 0.0]", "robots.grasps[0].position", "[-0.2, 0.0]", "expected 3 numbers"),
        ('name = "two"', "", "name", "missing", "required"),
        ('name = "two"', 'name = "../two"', "name", '"../two"', "lower-case"),
        ('name = "two"', 'name = "two"\nefficient.memory = 0.2', "efficient.memory", "0.2", "of at least 0.3"),
        ('name = "two"', 'name = "two"\nspeed = 3', "speed", "no such key", "duration"),
        ('kind = "line"', 'kind = "lien"', "graph.kind", '"lien"', '"line"'),
        ('kind = "line"', 'kinds = "line"', "graph.kinds", "no such key. Did you mean 'kind'?", "edge_probability"),
        ("duration = 12.0", "durations = 12.0", "durations", "Did you mean 'duration'?", "Allowed here: name"),
        ("duration = 12.0", "zzz = 12.0", "zzz", "there is no such key. Allowed here", "duration"),
        (
            "[graph]",
            "[robots]\nsites = [{ position = [1, 2, 3] }]\n[graph]",
            "robots.sites[0]",
            "{ position = [1, 2, 3] }",
            "names of sites",
        ),
        ("frequency = [0.4, 1.6]", "frequency = [1.6, 0.4]", "motion.frequency", "[1.6, 0.4]", "lower"),
        ("frequency = [0.4, 1.6]", "via_points.dwell = [2.0, 0.8]", "motion.via_points.dwell", "[2.0, 0.8]", "shorter"),
        ("frequency = [0.4, 1.6]", "ramp = -1", "motion.ramp", "-1", "of at least 0"),
        ("duration = 12.0", "duration = 0", "duration", "0", "greater than 0"),
        ("duration = 12.0", 'estimator = "best"', "estimator", "'best'", "efficient, fan2017"),
        ("duration = 12.0", "sensors.rate = 300", "sensors.rate", "300", "500"),
        ("duration = 12.0", "sensors.block = 1", "sensors.block", "1", "a whole number of at least 2"),
        ("duration = 12.0", "sensors.noise.gyro = -1.0", "sensors.noise.gyro", "-1.0", "greater than 0"),
        ("duration = 12.0", "sensors.noise.torque = 0", "sensors.noise.torque", "0", "greater than 0"),
        ("duration = 12.0", "sensors.noise_scale = 0", "sensors.noise_scale", "0", "greater than 0"),
        ("duration = 12.0", "sensors.noise_scale = 1e-4", "sensors.noise.gyro", "0.005, times", "at least 5e-06"),
        ("duration = 12.0", "sensors.noise.torque = 1e-6", "sensors.noise.torque", "1e-06, times", "at least 3e-05"),
        ("duration = 12.0", "sensors = 3", "sensors", "3", "a section, written [sensors]"),
        (
            "[[load_changes]]",
            "[load_changes]",
            "load_changes",
            "{ at = 5.0, mass",
            "sections, each written [[load_changes]]",
        ),
        ("[graph]", "[[graph]]", "graph", '[{ kind = "line" }]', "a section, written [graph]"),
        ('kind = "line"', "kind = 3", "graph.kind", "3", 'one of "complete", "grid", "line"'),
        (
            'name = "two"',
            'name = "My payload"',
            "name",
            '"My payload"',
            "text: a lower-case letter, then up to 31",
        ),
        (
            'name = "two"',
            'name = "two"\nsettings.a = 3',
            "settings",
            "{ a = 3 }",
            "tables, each written [settings.NAME]",
        ),
        ('name = "two"', 'name = "two"\nefficient.memory = "x"', "efficient.memory", '"x"', '"window", a number'),
        ("duration = 12.0", "duration = 12.0\nseed = 1.5", "seed", "1.5", "a whole number; found"),
        ("[0.2, 0.0, 0.0]", "{ x = 0.2 }", "robots.grasps[1].position", "{ x = 0.2 }", "3 numbers"),
        ("mass = 1.0", "", "load_changes[0]", "neither 'mass' nor 'remove'", "exactly one"),
        ("mass = 1.0", "mass = 1.0\nremove = 1", "load_changes[0]", "both", "exactly one"),
        ("mass = 1.0", "mass = 1.0\nleak = -0.1", "load_changes[0].leak", "-0.1", "of at least 0"),
        ("mass = 1.0", "remove = 1\nleak = 0.1", "load_changes[0].leak", "0.1 without 'mass'", "new load"),
        ("[graph]", "[robots.perimeter]\ncount = 2\nextent = [1, 1]\n[graph]", "robots", "both", "exactly one"),
        ("mass = 1.0", "remove = 1", "load_changes[0].remove", "1 at 5.0 s", "none"),
        ("[payload]", "[payload]\nload_slots = 0", "load_changes[0]", "1 loads at a time", "'payload.load_slots' is 0"),
        ("at = 5.0", "at = 11.99", "load_changes[0].at", "11.99 s", "at most 11.98 s"),
        ("[[robots.grasps]]\nposition = [0.2, 0.0, 0.0]\n", "", "robots.grasps", "1 grasp", "at least 2"),
    ],
)
def test_errors_tell_file_key_found_and_allowed(good: str, bad: str, key: str, found: str, allowed: str) -> None:
    assert good in GOOD
    with pytest.raises(ScenarioError) as error:
        parse_scenario(GOOD.replace(good, bad, 1), "two.toml")
    message = str(error.value)
    assert message.startswith(f"two.toml: key '{key}': ")
    assert found in message
    assert allowed in message
    assert len(message) < 300


@pytest.mark.parametrize(
    ("line", "now"),
    [
        ("efficient.offsets = true", "sensors.tolerance = { force_offset = 1.2, torque_offset = 0.06 }"),
        ("sensors.offset = { force = 2.0 }", "sensors.errors = { force_offset = 1.2 }"),
    ],
)
def test_of_a_renamed_key_its_new_name_is_told_and_can_be_used(line: str, now: str) -> None:
    with pytest.raises(ScenarioError) as caught:
        parse_scenario(f"{line}\n{GOOD}", "my.toml")
    assert line.partition(" ")[0] in str(caught.value)
    assert now in str(caught.value)
    parse_scenario(f"{now}\n{GOOD}", "my.toml")


def test_text_that_is_not_toml() -> None:
    with pytest.raises(ScenarioError, match=r"two.toml: not valid TOML: .*line 2"):
        parse_scenario("name = 'two'\nduration = = 3", "two.toml")


def test_names_that_are_not_there() -> None:
    with pytest.raises(ScenarioError, match=r"no scenario 'rign6'. Did you mean 'ring6'\?.*Shipped.*line4"):
        load_scenario("rign6")


@pytest.mark.parametrize(("name", "key"), [("shelf.xml", "mjcf"), ("shelf.STL", "mesh")])
def test_a_payload_is_no_scenario(name: str, key: str) -> None:
    with pytest.raises(ScenarioError, match=rf"'{name}' is a payload, not a scenario.*payload.{key} = \"{name}\""):
        load_scenario(name)


def test_a_file_is_meant_but_its_suffix_left_out(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "lmesh.toml").write_text(GOOD)
    with pytest.raises(ScenarioError, match=r"no scenario 'lmesh', but there is a file 'lmesh.toml': give its whole"):
        load_scenario("lmesh")
    with pytest.raises(ScenarioError, match=r"there is no scenario 'xxx"):
        load_scenario(5000 * "x")


def test_a_file_that_is_not_there(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    with pytest.raises(ScenarioError) as error:
        load_scenario("nofile.toml")
    assert str(error.value) == (
        f"nofile.toml: cannot be read: No such file or directory; looked for {tmp_path / 'nofile.toml'}. "
        f"'coheft scenarios' lists the shipped ones, which have names without .toml"
    )
    with pytest.raises(ScenarioError, match=r"Did you mean 'ring6'\?"):
        load_scenario("ring6.toml")


def test_files_that_cannot_be_read(tmp_path: Path) -> None:
    with pytest.raises(ScenarioError, match=r"missing.toml: cannot be read: No such file"):
        load_scenario(tmp_path / "missing.toml")
    binary = tmp_path / "binary.toml"
    binary.write_bytes(b"\xff\xfe")
    with pytest.raises(ScenarioError, match=r"binary.toml: not UTF-8"):
        load_scenario(binary)


def test_a_file_may_begin_with_a_byte_order_mark(tmp_path: Path) -> None:
    path = tmp_path / "windows.toml"
    path.write_text(GOOD, encoding="utf-8-sig")
    assert load_scenario(path).name == "two"
    hosts = tmp_path / "hosts.toml"
    hosts.write_text('[hosts]\nserver = "localhost"\n', encoding="utf-8-sig")
    assert load_hosts(hosts, load_scenario(path)).of("r1") == "127.0.0.1"


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("[hosts]\nr1 = 7", "key 'hosts': expected a text under each name; found { r1 = 7 }"),
        ("port = 99999\n[hosts]", "key 'port': expected .*; found 99999"),
        ("[hosts]\nr9 = 'a'", r"no such part; available: server, r1, r2"),
        ("[hosts]\nr1 = ''", r'key .hosts\.r1.: found "", expected an address'),
        ("[hosts]\nr1 = '10.0.0.1/24'", r'key .hosts\.r1.: found "10\.0\.0\.1/24"'),
        ("[hosts]\nr1 = '10.0.0.300'", r'key .hosts\.r1.: found "10\.0\.0\.300"'),
    ],
)
def test_hosts_that_cannot_be(text: str, complaint: str, tmp_path: Path) -> None:
    hosts = tmp_path / "hosts.toml"
    hosts.write_text(text)
    with pytest.raises(ScenarioError, match=complaint):
        load_hosts(hosts, parse_scenario(GOOD, "two"))


def test_the_reference_is_up_to_date_and_its_example_is_a_scenario() -> None:
    assert scenario_reference.PAGE.read_text() == scenario_reference.page(), "run python docs/scenario_reference.py"
    example = re.search(r"```toml\n(.*?)```", scenario_reference.page(), re.DOTALL)
    assert example is not None
    assert parse_scenario(example[1], "docs/scenarios.md").robot_count == 2
