"""The files for containers: each part has one, and the commands in them are right."""

from __future__ import annotations

import shlex
from pathlib import Path
from typing import Any

import pytest

from coheft.app.cli.main import run_command_line

yaml = pytest.importorskip("yaml", reason="takes the package PyYAML")
FOLDER = Path(__file__).parents[1] / "docker"


@pytest.fixture(scope="module")
def services() -> dict[str, Any]:
    found: dict[str, Any] = yaml.safe_load((FOLDER / "compose.yaml").read_text())["services"]
    return found


def test_the_configs_that_are_made_are_those_that_parts_read(
    services: dict[str, Any], tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    pytest.importorskip("cryptography", reason="takes coheft[secure]")
    (script,) = services["configs"]["command"]
    place = str(tmp_path / "made")
    here = script.replace("/run/coheft", place).replace("/hosts.toml", str(FOLDER / "hosts.toml"))
    for line in here.splitlines():
        words = shlex.split(line)
        if words[0] == "coheft":
            assert run_command_line(words[1:]) == 0, capfd.readouterr().err
    printed = capfd.readouterr().out
    for name in ("server", "r1", "r2", "r3"):
        command, path = services[name]["command"]
        assert f"coheft {command} {path.replace('/run/coheft', place)}" in printed
        assert Path(path.replace("/run/coheft", place)).is_file()
    assert services["watch"]["command"] == ["watch", "--run", "/run/coheft/parts"]


def test_every_part_waits_for_its_configuration(services: dict[str, Any]) -> None:
    for name, service in services.items():
        if name != "configs":
            assert service["depends_on"] == {"configs": {"condition": "service_completed_successfully"}}
            assert service["image"] == "coheft"
