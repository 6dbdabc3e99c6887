"""The benchmark that compares the whole system and its bare floor with Zenoh alone."""

from __future__ import annotations

import pytest

from benchmarks.check import load_committed
from benchmarks.figures import Section, guarded
from benchmarks.floor import Turns, figures_of
from benchmarks.paced_team import SIZES, Turn


def turn(wall: float, agent: float, server: float) -> Turn:
    """Ten blocks of two robots, with times per block."""
    cpu = {"server": 10 * server, "r1": 10 * agent, "r2": 10 * agent}
    return Turn(blocks=10, wall=10 * wall, cpu=cpu)


TURNS = Turns(
    whole=[turn(6.0, 4.0, 2.0), turn(60.0, 4.0, 2.0), turn(8.0, 4.0, 2.0)],
    bare=[turn(4.0, 1.5, 1.0)] * 3,
    zenoh=[turn(2.0, 0.5, 1.0)] * 3,
    steps=[0.25] * 3,
)


def test_ratios_are_medians_of_what_was_side_by_side() -> None:
    assert {key: figure.value for key, figure in figures_of(6, TURNS).items()} == {
        "whole_over_zenoh": 4.0,
        "bare_over_zenoh": 2.0,
        "whole_over_zenoh_cpu": 5.0,
        "bare_over_zenoh_cpu": 2.0,
        "server_over_bare_server": 2.0,
        "server_over_steps": 8.0,
        "agent_over_bare_agent": pytest.approx(8.0 / 3.0),
    }


@pytest.mark.parametrize("robots", SIZES)
def test_what_is_guarded_has_been_committed(robots: int) -> None:
    figures = figures_of(robots, TURNS).values()
    found = guarded([Section(name="floor", title="", figures=list(figures))])
    assert found.keys() <= load_committed().keys()
    assert len(found) == 3
