"""Scenarios for benchmarks: any number of robots, any rate, without load changes."""

from __future__ import annotations

from msgspec.structs import replace

from coheft.wire.scenario.file import load_scenario
from coheft.wire.scenario.schema import Scenario

RATE = 1000
BLOCK = 20
"""Samples per block: 50 blocks a second at 1 kHz."""
_FOREVER = 1e6
_STRONG = 24
"""Number of robots above which arms are weakened in proportion, because together they would be unstable."""


def team_scenario(robots: int, rate: int = RATE, block: int = BLOCK, duration: float = _FOREVER) -> Scenario:
    """Return a ring with the payload of the smallest shipped ring that has as many robots, or of the largest one.

    Args:
        robots: Number of robots.
        rate: Samples per second.
        block: Samples per block.
        duration: Simulated time [s].
    """
    base = load_scenario(next((f"ring{count}" for count in (3, 6, 12, 24) if robots <= count), "ring24"))
    assert base.robots.perimeter is not None
    return replace(
        base,
        robots=replace(base.robots, perimeter=replace(base.robots.perimeter, count=robots)),
        sensors=replace(base.sensors, rate=rate, block=block),
        load_changes=(),
        duration=duration,
    )


def weaker(scenario: Scenario) -> Scenario:
    """Return the scenario with arms that together are as strong as those of ``_STRONG`` robots."""
    robots, share = scenario.robots, min(1.0, _STRONG / scenario.robot_count)
    return replace(
        scenario,
        robots=replace(
            robots,
            stiffness=(share * robots.stiffness[0], share * robots.stiffness[1]),
            damping=(share * robots.damping[0], share * robots.damping[1]),
        ),
    )
