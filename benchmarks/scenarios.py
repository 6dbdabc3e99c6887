"""Scenarios for benchmarks: any number of robots, any rate, without load changes."""

from msgspec.structs import replace

from coheft.wire.scenario.file import load_scenario
from coheft.wire.scenario.schema import Scenario

RATE = 1000
BLOCK = 20
"""Samples per block: 50 blocks a second at 1 kHz."""
SETTLED = 12.0
"""Time after which the cost of a block is that of the rest of the run, because fits have become rare [s]."""
_ENDLESS = 1e6


def team_scenario(robots: int, rate: int = RATE, block: int = BLOCK, duration: float = _ENDLESS) -> Scenario:
    """Return a ring with the payload of the smallest shipped ring that has as many robots, or of the largest one.

    ``rate`` is in samples per second, ``block`` in samples, ``duration`` in simulated seconds.
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
