"""A run whose server fails has failed, whoever of its processes ends first."""

from __future__ import annotations

from collections.abc import Callable
from io import StringIO
from pathlib import Path

import msgspec
import pytest
from rich.console import Console

from coheft.app.cart.launch import run_in_processes
from coheft.app.cart.table_one import table_one
from coheft.app.run.launch import launch
from coheft.app.run.plan import make_plan
from coheft.app.run.processes import Child, ProcessError, Processes
from coheft.app.terminal.screen import make_display
from coheft.wire.scenario.file import parse_scenario

from .team import ROOT

TURNED_OVER = """
name = "turned-over"
duration = 5.0
payload.boxes = [{ mass = 6.0, size = [0.8, 0.3, 0.1] }]
robots.grasps = [{ position = [-0.4, 0.0, 0.0] }, { position = [0.4, 0.0, 0.0], rotation_deg = [0, 0, 180] }]
graph.kind = "line"
motion.rotation = 4.0
"""
"""Two arms may turn so far, but not the payload with them."""


@pytest.fixture
def use_server(monkeypatch: pytest.MonkeyPatch) -> Callable[[str], None]:
    """Lets runs have another server."""
    start = Processes.start

    def use(server: str) -> None:
        def start_another_server(processes: Processes, name: str, module: str, config: msgspec.Struct) -> Child:
            return start(processes, name, server if name == "server" else module, config)

        monkeypatch.setattr(Processes, "start", start_another_server)
        monkeypatch.setenv("PYTHONPATH", str(ROOT))

    return use


def test_a_server_that_fails_and_ends_after_its_agents_ends_the_run_with_an_error(
    use_server: Callable[[str], None], tmp_path: Path
) -> None:
    use_server("tests.integration.slow_to_end_server")
    scenario = parse_scenario(TURNED_OVER, "turned.toml")
    expected = r"the robots have lost the payload(?s:.)*\nThe run is over, because server ended with status 1\.$"
    shown = StringIO()
    with pytest.raises(ProcessError, match=expected):
        launch(make_plan(scenario), tmp_path, make_display(Console(file=shown)))
    assert "have lost the payload" not in shown.getvalue(), "the error says it"


def test_so_does_the_server_of_a_cart(use_server: Callable[[str], None], tmp_path: Path) -> None:
    use_server("tests.integration.slow_to_end_cart_server")
    expected = r"the cart has moved out of bounds(?s:.)*\nThe run is over, because server ended with status 1\.$"
    with pytest.raises(ProcessError, match=expected):
        run_in_processes(table_one(6, pushers=1), lambda _: tmp_path, lambda _: None)
