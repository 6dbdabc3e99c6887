"""A load of a run that goes on, for an arm."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from tests.integration.command_line import Run
from tests.waiting import wait_until


def test_a_run_that_goes_on_tells_the_load(start: Callable[..., Run]) -> None:
    run = start("--duration", "10000", "--change", "t=9999,mass=1")
    run.wait_for_results()
    wait_until(lambda: "3 converged" in run.text, "all robots to know the load")
    status, text = run.ask("export", "--as", "ur", "--robot", "r2")
    assert status == 0, text
    assert "found by r2" in text
    mass = float(text.splitlines()[-1].removeprefix("set_target_payload(").partition(",")[0])
    assert mass == pytest.approx(5.0, rel=0.01)
    status, text = run.ask("export", "--as", "ur", "--robot", "r7")
    assert status == 1
    assert "the robots are r1, r2, r3" in text
