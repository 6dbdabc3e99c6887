"""Random schedules: a small team that is quick to simulate, and up to four faults."""

from collections.abc import Sequence
from typing import Any, TypeVar, get_args

import msgspec
import numpy as np

from coheft.app.faults.lasting import with_lasting_errors
from coheft.app.faults.recovery import latest_recovery
from coheft.app.faults.schedule import (
    ALL_ROBOTS,
    AnyFault,
    ClockSkew,
    Corruption,
    Crash,
    Delay,
    Duplication,
    FaultSchedule,
    Lie,
    LieKind,
    Loss,
    Malformed,
    Partition,
    Pause,
    Release,
    Reordering,
    Replay,
    ReplaySource,
    Sensor,
    SensorFailure,
    SensorFault,
)
from coheft.app.faults.unlike import with_unlike_robots
from coheft.consensus.graph import build_graph
from coheft.errors import ScenarioError
from coheft.estimation.tolerance import INDUSTRIAL, SensorTolerance
from coheft.wire.scenario.file import with_values
from coheft.wire.scenario.motion import Motion
from coheft.wire.scenario.payload import Box, Payload
from coheft.wire.scenario.schema import Graph, LoadChange, Perimeter, Robots, Scenario, Sensors
from coheft.wire.scenario.section import Vector

MOST_FAULTS = 4
LATEST_START = 5.0
"""Latest start of a fault, without ``DELAY`` [s]; a team without faults is valid after 3 to 7 s."""
DELAY = 4.0
"""In every other schedule everything happens later by this: most teams then have known their load for long [s]."""
_CONTINUATION = 5.5
"""Time for which a run continues after the last event, unless an agent never comes back [s]."""
_CONTINUATION_AFTER_RELEASE = 6.5
"""Time for which a run continues after the last fault, if a robot releases the load [s]."""
_SHORTEST = 7.0
"""Shortest run [s]."""
_COUNTS = (0.4, 0.3, 0.2, 0.1)
"""Shares of teams of 3, 4, 5 and 6 robots: small ones are quick to simulate."""
LASTING, UNLIKE = 0.5, 0.3
"""Shares of schedules with small lasting errors, and in which robots differ or slip."""
_PERMANENT = 0.1
"""Share of crashed agents that never come back."""

_KINDS = (
    *("delay", "loss", "duplication", "reordering", "corruption", "replay", "malformed", "partition"),
    *("crash", "crash", "pause", "release", "clock skew", "sensor", "sensor", "lie"),
)
"""Kinds of faults; those that are named twice are drawn twice as often."""
_DRAWN = ("robots", "graph", "duration", "seed")
"""Keys that may not be set, because faults refer to robots, links and times."""
_Fields = dict[str, Any]
"""Fields of a fault."""

T = TypeVar("T")

_replace = msgspec.structs.replace


def draw_schedule(seed: int, values: Sequence[str] = ()) -> FaultSchedule:
    """Draw the schedule of a seed, any number of at least 0.

    Sensors of two of four seeds have the errors of an industrial arm, with known tolerances; the others' only have
    noise and faults. ``values`` are keys of the scenario that are set instead of drawn, see
    ``coheft.wire.scenario.set_values``; a ``ScenarioError`` says that one is invalid, or changes the robots or links
    that faults refer to.
    """
    schedule = draw_early(seed)
    if seed % 4 >= 2:
        sensors = _replace(schedule.scenario.sensors, tolerance=INDUSTRIAL)
        schedule = _replace(schedule, scenario=_replace(schedule.scenario, sensors=sensors))
    is_late = seed % 2 == 1
    if is_late:
        schedule = later(schedule)
    rng = np.random.default_rng([seed, 1])  # a separate stream, so that all else is drawn as before
    if rng.random() < LASTING:
        schedule = with_lasting_errors(schedule, rng)
    rng = np.random.default_rng([seed, 2])  # another one, for the same reason
    if rng.random() < UNLIKE:
        schedule = with_unlike_robots(schedule, rng, DELAY if is_late else 0.0)
    schedule = long_enough(schedule)
    return long_enough(_with_values(schedule, values)) if values else schedule


def _with_values(schedule: FaultSchedule, values: Sequence[str]) -> FaultSchedule:
    chosen = with_values(schedule.scenario, values)
    for key in _DRAWN:
        if getattr(chosen, key) != getattr(schedule.scenario, key):
            raise ScenarioError(f"{chosen.name}: key '{key}' is drawn together with the faults: leave it out")
    return _replace(schedule, scenario=chosen)


def later(schedule: FaultSchedule) -> FaultSchedule:
    """Return the schedule with everything ``DELAY`` later."""
    scenario = schedule.scenario
    changes = tuple(_replace(change, at=_round(change.at + DELAY)) for change in scenario.load_changes)
    scenario = _replace(scenario, duration=_round(scenario.duration + DELAY), load_changes=changes)
    faults = tuple(
        _replace(fault, start=_round(fault.start + DELAY), end=_round(fault.end + DELAY)) for fault in schedule.faults
    )
    return _replace(schedule, scenario=scenario, faults=faults)


def long_enough(schedule: FaultSchedule) -> FaultSchedule:
    """Extend the run until all robots have to be valid again; unless an agent never comes back, as they will not be."""
    scenario = schedule.scenario
    if schedule.last_fault_end >= scenario.duration:
        return schedule
    duration = max(scenario.duration, _round(latest_recovery(schedule)) + scenario.block_duration)
    return _replace(schedule, scenario=_replace(scenario, duration=duration))


def draw_early(seed: int) -> FaultSchedule:
    """Draw faults and a team whose robots are alike, with sensors that only have noise and these faults."""
    rng = np.random.default_rng(seed)
    count = int(rng.choice([3, 4, 5, 6], p=_COUNTS))
    team = _Team(rng, count)
    faults = tuple(team.fault() for _ in range(rng.integers(0, MOST_FAULTS + 1)))
    afterwards = _CONTINUATION_AFTER_RELEASE if any(isinstance(fault, Release) for fault in faults) else _CONTINUATION
    duration = _round(max([_SHORTEST, *(fault.end + afterwards for fault in faults)]))
    faults = tuple(
        _replace(fault, end=duration) if rng.random() < _PERMANENT and isinstance(fault, Crash) else fault
        for fault in faults
    )
    return FaultSchedule(seed=seed, scenario=team.scenario(seed, duration), faults=faults)


class _Team:
    """Draws the parts that depend on the robots' names and on the graph."""

    def __init__(self, rng: np.random.Generator, count: int) -> None:
        self._rng = rng
        self._extent = (_round(rng.uniform(0.6, 1.2)), _round(rng.uniform(0.5, 0.9)))
        self._count = count
        self._graph = Graph(
            kind=self._pick("ring", "line", "star", "complete", "random"),
            edge_probability=_round(rng.uniform(0.1, 0.5)),
            seed=_seed(rng),
        )
        self._robots = Robots(perimeter=Perimeter(count=count, extent=self._extent, seed=_seed(rng)))
        # In larger teams it takes more blocks until messages have reached all robots.
        self._block = int(rng.choice([5, 8] if count <= 4 else [4, 5]))
        self._names = tuple(f"r{i + 1}" for i in range(count))
        self._edges = [
            (name, other) for name, others in build_graph(self._graph, self._names).items() for other in others
        ]

    def scenario(self, seed: int, duration: float) -> Scenario:
        """Draw the scenario."""
        rng = self._rng
        width, depth = self._extent
        plate = Box(mass=self._number(2.0, 8.0), size=(width, depth, 0.05))
        lump = Box(mass=self._number(0.5, 4.0), size=(0.2, 0.15, 0.15), position=self._place())
        changes = sorted(_round(rng.uniform(1.0, duration - _CONTINUATION)) for _ in range(rng.integers(0, 3)))
        return Scenario(
            name=f"faults-{seed}",
            payload=Payload(boxes=(plate, lump)),
            robots=self._robots,
            graph=self._graph,
            sensors=Sensors(
                rate=100,
                block=self._block,
                noise_scale=_round(0.3 * 3.0 ** rng.random()),
                tolerance=SensorTolerance(),
            ),
            motion=Motion(rotation=0.3, ramp=self._number(0.3, 1.0)),
            load_changes=tuple(self._load_change(time, number) for number, time in enumerate(changes)),
            duration=duration,
            seed=seed,
            lookahead=int(rng.integers(1, 5)),
        )

    def _load_change(self, time: float, number: int) -> LoadChange:
        if number == 1 and self._rng.random() < 0.5:
            return LoadChange(at=time, remove=1)
        return LoadChange(at=time, mass=self._number(0.5, 3.0), position=self._place())

    def _place(self) -> Vector:
        x, y = self._rng.uniform(-0.4, 0.4, size=2) * self._extent
        return _round(x), _round(y), 0.1

    def fault(self) -> AnyFault:
        """Draw one fault."""
        rng = self._rng
        start = rng.uniform(0.0, LATEST_START)
        end = start + 0.1 * 30.0 ** rng.random()
        kind = self._pick(*_KINDS)
        when: _Fields = {"start": _round(start), "end": _round(end), "seed": _seed(rng)}
        match kind:
            case "delay":
                return Delay(**when, **self._link(), blocks=self._blocks())
            case "loss":
                return Loss(**when, **self._link(), probability=self._number(0.01, 0.5))
            case "duplication":
                link, probability = self._link(), self._number(0.1, 1.0)
                return Duplication(**when, **link, probability=probability, blocks=self._blocks(20) - 1)
            case "reordering":
                return Reordering(**when, **self._link(), blocks=self._blocks())
            case "corruption":
                link, probability = self._link(), _round(0.01 * 100.0 ** rng.random())
                bits, sealed = round(32.0 ** rng.random()), bool(rng.random() < 0.5)
                return Corruption(**when, **link, probability=probability, bits=bits, sealed=sealed)
            case "replay":
                link, probability = self._link(), self._number(0.1, 1.0)
                source = self._pick(*get_args(ReplaySource))
                return Replay(**when, **link, probability=probability, source=source)
            case "malformed":
                return Malformed(**when, **self._link(), probability=self._number(0.1, 1.0))
            case "partition":
                size = rng.integers(1, self._count // 2 + 1)
                group = rng.choice(self._count, size=size, replace=False)
                return Partition(**when, group=tuple(self._names[k] for k in sorted(group)))
            case "crash":
                return Crash(**when, robot=self._robot())
            case "pause":
                return Pause(**when, robot=self._robot())
            case "release":
                if rng.random() < 0.3:
                    when["start"] = 0.0
                return Release(**when, robot=self._robot(), notice=self._blocks() if rng.random() < 0.5 else 0)
            case "clock skew":
                return ClockSkew(**when, robot=self._robot(), samples=self._blocks(2 * self._block))
            case "sensor":
                return self._sensor_fault(when)
            case _:
                return self._lie(when)

    def _pick(self, *choices: T) -> T:
        return choices[self._rng.integers(len(choices))]

    def _robot(self) -> str:
        return self._pick(*self._names)

    def _link(self) -> _Fields:
        """Draw one link, all links to or from one robot, or all links."""
        sender, receiver = self._pick(*self._edges)
        return {"sender": self._pick(sender, ALL_ROBOTS), "receiver": self._pick(receiver, ALL_ROBOTS)}

    def _number(self, low: float, high: float) -> float:
        return _round(self._rng.uniform(low, high))

    def _blocks(self, most: int = 10) -> int:
        return int(self._rng.integers(1, most + 1))

    def _sensor_fault(self, when: _Fields) -> AnyFault:
        rng = self._rng
        sensor, how = self._pick(*get_args(Sensor)), self._pick(*get_args(SensorFailure))
        sizes = {  # all are drawn, so that the later draws do not depend on the choice
            "nan": rng.uniform(0.01, 1.0),
            "frozen": 1.0,
            "outliers": rng.uniform(0.01, 0.5),
            "saturation": rng.uniform(0.2, 1.0),
            "offset": 5.0 * 200.0 ** rng.random(),
        }
        return SensorFault(**when, robot=self._robot(), sensor=sensor, how=how, size=_round(sizes[how]))

    def _lie(self, when: _Fields) -> AnyFault:
        rng = self._rng
        how, factor = self._pick(*get_args(LieKind)), 1.2 * 3.0 ** rng.random()
        sizes = {
            "scaled": factor if rng.random() < 0.5 else 1.0 / factor,
            "offset": 0.03 * 100.0 ** rng.random(),
            "garbage": 1.0,
        }
        return Lie(**when, robot=self._robot(), how=how, size=_round(sizes[how]))


def _round(value: float) -> float:
    return round(float(value), 3)


def _seed(rng: np.random.Generator) -> int:
    return int(rng.integers(2**32))
