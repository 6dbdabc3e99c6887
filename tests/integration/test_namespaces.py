"""A secure run on three hosts, by configuration only; one of them loses its link and gets it back."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

import pytest

from coheft.wire.process.supervised import ONE_THREAD

from .namespaces import Host, hosts
from .team import ROOT, wait_until

SCENARIO = """
name = "three-hosts"
duration = 10000.0
payload = { boxes = [{ mass = 8.0, size = [0.8, 0.6, 0.1] }], load_slots = 2 }
robots = { perimeter = { count = 3, extent = [0.8, 0.6] } }
graph = { kind = "line" }
"""
PLACES = {"server": 0, "r1": 1, "r2": 1, "r3": 2}
"""Which host each part is on; r2 is the neighbour of both others."""


class Parts:
    """The parts of a run, each started by hand on its own host."""

    def __init__(self, folder: Path, places: dict[str, Host]) -> None:
        self.folder = folder
        self.places = places
        self._onlooker = folder / "onlooker.log"

    def run_at(self, name: str, *arguments: str) -> subprocess.CompletedProcess[str]:
        """Run a command of coheft to its end, on the host of a part."""
        command = self.places[name].command(sys.executable, "-m", "coheft", *arguments)
        return subprocess.run(command, capture_output=True, text=True, cwd=ROOT, env=_environment(), timeout=60)

    @contextmanager
    def started(self, name: str, log: str, *arguments: str) -> Iterator[None]:
        """Keep a process running on the host of a part."""
        command = self.places[name].command(sys.executable, *arguments)
        with (self.folder / log).open("wb") as output:
            process = subprocess.Popen(command, stdout=output, stderr=output, cwd=ROOT, env=_environment())
        try:
            yield
        finally:
            process.terminate()
            process.wait(30)

    def seen(self) -> dict[str, dict[str, Any]]:
        """The last that an observer heard of everyone."""
        lines = self._onlooker.read_text().splitlines(keepends=True) if self._onlooker.exists() else []
        parsed = [json.loads(line) for line in lines if line.startswith("{") and line.endswith("\n")]
        return {line["who"]: line for line in parsed}

    def wait_for(self, what: str, **statuses: str) -> None:
        """Wait until agents say of their estimates what is expected, in blocks that are still to come."""
        now = {name: seen["block"] for name, seen in self.seen().items()}

        def is_so() -> bool:
            seen = self.seen()
            return all(
                name in seen and seen[name]["block"] > now.get(name, -1) and seen[name]["status"] == status
                for name, status in statuses.items()
            )

        try:
            wait_until(is_so, what)
        except AssertionError as error:
            logs = "".join(f"\n{path.name}: {path.read_text()[-1500:]}" for path in self.folder.glob("*.log"))
            raise AssertionError(f"{error}{logs}") from error

    def wait_for_blocks(self, count: int) -> None:
        """Wait until the server has gone on by so many blocks."""
        target = self.seen()["server"]["block"] + count
        wait_until(lambda: bool(self.seen()["server"]["block"] >= target), f"block {target}")


def _environment() -> dict[str, str]:
    return {**os.environ, "PYTHONPATH": str(ROOT), **ONE_THREAD}


@pytest.fixture
def parts(tmp_path: Path) -> Iterator[Parts]:
    """A run whose server and agents are all there, configured by one command with a table of hosts."""
    with hosts(3) as three, ExitStack() as stack:
        parts = Parts(tmp_path, {name: three[index] for name, index in PLACES.items()})
        (tmp_path / "scenario.toml").write_text(SCENARIO)
        addresses = "\n".join(f'{name} = "{host.address}"' for name, host in parts.places.items())
        (tmp_path / "hosts.toml").write_text(f"[hosts]\n{addresses}\n")
        made = parts.run_at(
            "server", "run", str(tmp_path / "scenario.toml"), "--realtime", "--secure",
            "--hosts", str(tmp_path / "hosts.toml"), "--write-configs", str(tmp_path / "run"),
        )  # fmt: skip
        assert made.returncode == 0, made.stderr
        for name in PLACES:
            part = "server" if name == "server" else "agent"
            config = str(tmp_path / "run" / f"{name}.json")
            stack.enter_context(parts.started(name, f"{name}.log", "-m", "coheft", part, config))
        stack.enter_context(
            parts.started("server", "onlooker.log", "-m", "tests.integration.onlooker", str(tmp_path / "run"))
        )
        yield parts


def test_a_host_that_is_cut_off_rejoins(parts):
    parts.wait_for("all to know the load", r1="valid", r2="valid", r3="valid")
    cut_off = parts.places["r3"]
    cut_off.set_link("down")
    parts.wait_for("those who go on to know that they cannot know", r1="stale", r2="stale")
    parts.wait_for_blocks(100)
    assert any("r3" in reason for reason in parts.seen()["r2"]["why"]), parts.seen()
    cut_off.set_link("up")
    parts.wait_for("all to know the load again", r1="valid", r2="valid", r3="valid")
    stopped = parts.run_at("server", "stop", "--run", str(parts.folder / "run"))
    assert stopped.returncode == 0, stopped.stderr
