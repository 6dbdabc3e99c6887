"""Schedules drawn at random: a small team, quick to simulate, and up to four faults."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, TypeVar

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
    Sensor,
    SensorFailure,
    SensorFault,
)
from coheft.app.faults.values import with_values
from coheft.consensus.graph import build_graph
from coheft.estimation.tolerance import INDUSTRIAL, SensorTolerance
from coheft.wire.scenario.payload import Box, Payload
from coheft.wire.scenario.schema import Graph, LoadChange, Motion, Perimeter, Robots, Scenario, Sensors
from coheft.wire.scenario.section import Vector

MOST_FAULTS = 4
LATEST_START = 5.0
"""Until then faults begin, but for ``DELAY`` [s]; a team without faults is valid after 3 to 7 s."""
DELAY = 4.0
"""In every other schedule everything happens so much later: then most teams have long known what they hold [s]."""
_AFTERWARDS = 5.5
"""A run goes on for at least so long after everything has happened, but for agents that never come back [s]."""
_AFTERWARDS_OF_HOLD = 6.5
"""A run in which a robot lets go of the load goes on for at least so long after the last fault [s]."""
_SHORTEST = 7.0
"""Run [s]."""
_COUNTS = (0.4, 0.3, 0.2, 0.1)
"""Shares of teams of 3, 4, 5 and 6 robots: small ones are quick to simulate."""
_FOR_EVER = 0.1
"""Share of crashed agents that never come back."""

_Fields = dict[str, Any]
"""Fields of a fault."""

T = TypeVar("T")

_replace = msgspec.structs.replace


def draw_schedule(
    seed: int,
    delayed: bool | None = None,
    is_exact: bool | None = None,
    lasting: bool | None = None,
    values: Sequence[str] = (),
) -> FaultSchedule:
    """The schedule of a seed.

    Args:
        seed: Any number of at least 0.
        delayed: Whether everything happens ``DELAY`` later. None: every other seed.
        is_exact: Whether sensors are exact but for noise and faults, or those of an industrial arm, off as far as
            robots are told. None: two of four seeds.
        lasting: Whether there are small errors that last besides, see ``lasting``. None: every other time, unless it is
            said whether sensors are exact.
        values: Keys of the scenario that are not drawn, see ``coheft.wire.scenario.set_values``.

    Raises:
        ScenarioError: A value cannot be used, or changes whom the faults are about.
    """
    schedule = _draw_early(seed)
    if seed % 4 >= 2 if is_exact is None else not is_exact:
        sensors = _replace(schedule.scenario.sensors, tolerance=INDUSTRIAL)
        schedule = _replace(schedule, scenario=_replace(schedule.scenario, sensors=sensors))
    if seed % 2 if delayed is None else delayed:
        schedule = _later(schedule)
    rng = np.random.default_rng([seed, 1])  # of its own: what else is drawn stays as it is
    is_lasting = bool(rng.random() < 0.5)
    if (is_lasting and is_exact is None) if lasting is None else lasting:
        schedule = with_lasting_errors(schedule, rng)
    return _long_enough(with_values(schedule, values) if values else schedule)


def _later(schedule: FaultSchedule) -> FaultSchedule:
    """Everything happens ``DELAY`` later."""
    scenario = schedule.scenario
    changes = tuple(_replace(change, at=_round(change.at + DELAY)) for change in scenario.load_changes)
    scenario = _replace(scenario, duration=_round(scenario.duration + DELAY), load_changes=changes)
    faults = tuple(
        _replace(fault, start=_round(fault.start + DELAY), end=_round(fault.end + DELAY)) for fault in schedule.faults
    )
    return _replace(schedule, scenario=scenario, faults=faults)


def _long_enough(schedule: FaultSchedule) -> FaultSchedule:
    """It goes on until all have to be valid again; unless an agent never comes back: then no robot will be."""
    scenario = schedule.scenario
    if schedule.last_fault_end >= scenario.duration:
        return schedule
    duration = max(scenario.duration, _round(latest_recovery(schedule)) + scenario.block_duration)
    return _replace(schedule, scenario=_replace(scenario, duration=duration))


def _draw_early(seed: int) -> FaultSchedule:
    rng = np.random.default_rng(seed)
    count = int(rng.choice([3, 4, 5, 6], p=_COUNTS))
    team = _Team(rng, count)
    faults = tuple(team.fault() for _ in range(rng.integers(0, MOST_FAULTS + 1)))
    afterwards = _AFTERWARDS_OF_HOLD if any(isinstance(fault, Release) for fault in faults) else _AFTERWARDS
    duration = _round(max([_SHORTEST, *(fault.end + afterwards for fault in faults)]))
    faults = tuple(_for_ever(fault, duration) if rng.random() < _FOR_EVER else fault for fault in faults)
    return FaultSchedule(seed=seed, scenario=team.scenario(seed, duration), faults=faults)


class _Team:
    """Draws what depends on the robots' names and on the graph."""

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
        # In larger teams messages take more blocks to get everywhere.
        self._block = int(rng.choice([5, 8] if count <= 4 else [4, 5]))
        self._names = tuple(f"r{i + 1}" for i in range(count))
        self._edges = [
            (name, other) for name, others in build_graph(self._graph, self._names).items() for other in others
        ]

    def scenario(self, seed: int, duration: float) -> Scenario:
        """What is simulated."""
        rng = self._rng
        width, depth = self._extent
        plate = Box(mass=_round(rng.uniform(2.0, 8.0)), size=(width, depth, 0.05))
        lump = Box(mass=_round(rng.uniform(0.5, 4.0)), size=(0.2, 0.15, 0.15), position=self._place())
        changes = sorted(_round(rng.uniform(1.0, duration - _AFTERWARDS)) for _ in range(rng.integers(0, 3)))
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
            motion=Motion(rotation=0.3, ramp=_round(rng.uniform(0.3, 1.0))),
            load_changes=tuple(self._load_change(time, number) for number, time in enumerate(changes)),
            duration=duration,
            seed=seed,
            lookahead=int(rng.integers(1, 5)),
        )

    def _load_change(self, time: float, number: int) -> LoadChange:
        if number == 1 and self._rng.random() < 0.5:
            return LoadChange(at=time, remove=1)
        return LoadChange(at=time, mass=_round(self._rng.uniform(0.5, 3.0)), position=self._place())

    def _place(self) -> Vector:
        """Somewhere on the plate."""
        x, y = self._rng.uniform(-0.4, 0.4, size=2) * self._extent
        return _round(x), _round(y), 0.1

    def fault(self) -> AnyFault:
        """One fault."""
        kinds: list[Callable[[_Fields], AnyFault]] = [
            self._delay,
            self._loss,
            self._duplication,
            self._reordering,
            self._corruption,
            self._replay,
            self._malformed,
            self._partition,
            self._crash,
            self._crash,
            self._pause,
            self._release,
            self._clock_skew,
            self._sensor,
            self._sensor,
            self._lie,
        ]
        start = self._rng.uniform(0.0, LATEST_START)
        end = start + 0.1 * 30.0 ** self._rng.random()
        return kinds[self._rng.integers(len(kinds))](
            {"start": _round(start), "end": _round(end), "seed": _seed(self._rng)}
        )

    def _pick(self, *choices: T) -> T:
        return choices[self._rng.integers(len(choices))]

    def _robot(self) -> str:
        return self._pick(*self._names)

    def _link(self) -> _Fields:
        """One link, all to or from one robot, or all."""
        sender, receiver = self._pick(*self._edges)
        return {"sender": self._pick(sender, ALL_ROBOTS), "receiver": self._pick(receiver, ALL_ROBOTS)}

    def _blocks(self, most: int = 10) -> int:
        return int(self._rng.integers(1, most + 1))

    def _delay(self, when: _Fields) -> AnyFault:
        return Delay(**when, **self._link(), blocks=self._blocks())

    def _loss(self, when: _Fields) -> AnyFault:
        return Loss(**when, **self._link(), probability=_round(self._rng.uniform(0.01, 0.5)))

    def _duplication(self, when: _Fields) -> AnyFault:
        return Duplication(
            **when, **self._link(), probability=_round(self._rng.uniform(0.1, 1.0)), blocks=self._blocks(20) - 1
        )

    def _reordering(self, when: _Fields) -> AnyFault:
        return Reordering(**when, **self._link(), blocks=self._blocks())

    def _corruption(self, when: _Fields) -> AnyFault:
        return Corruption(
            **when,
            **self._link(),
            probability=_round(0.01 * 100.0 ** self._rng.random()),
            bits=round(32.0 ** self._rng.random()),
            sealed=bool(self._rng.random() < 0.5),
        )

    def _replay(self, when: _Fields) -> AnyFault:
        return Replay(
            **when,
            **self._link(),
            probability=_round(self._rng.uniform(0.1, 1.0)),
            source=self._pick("had before", "former incarnation", "other run"),
        )

    def _malformed(self, when: _Fields) -> AnyFault:
        return Malformed(**when, **self._link(), probability=_round(self._rng.uniform(0.1, 1.0)))

    def _partition(self, when: _Fields) -> AnyFault:
        size = self._rng.integers(1, self._count // 2 + 1)
        group = self._rng.choice(self._count, size=size, replace=False)
        return Partition(**when, group=tuple(self._names[k] for k in sorted(group)))

    def _crash(self, when: _Fields) -> AnyFault:
        return Crash(**when, robot=self._robot())

    def _pause(self, when: _Fields) -> AnyFault:
        return Pause(**when, robot=self._robot())

    def _release(self, when: _Fields) -> AnyFault:
        if self._rng.random() < 0.3:
            when = when | {"start": 0.0}
        return Release(**when, robot=self._robot(), notice=self._blocks(10) if self._rng.random() < 0.5 else 0)

    def _clock_skew(self, when: _Fields) -> AnyFault:
        return ClockSkew(**when, robot=self._robot(), samples=self._blocks(2 * self._block))

    def _sensor(self, when: _Fields) -> AnyFault:
        rng = self._rng
        sensor: Sensor = self._pick("gyro", "velocity", "acceleration", "force", "torque")
        how: SensorFailure = self._pick("nan", "frozen", "outliers", "saturation", "offset")
        size = {
            "nan": rng.uniform(0.01, 1.0),
            "frozen": 1.0,
            "outliers": rng.uniform(0.01, 0.5),
            "saturation": rng.uniform(0.2, 1.0),
            "offset": 5.0 * 200.0 ** rng.random(),
        }[how]
        return SensorFault(**when, robot=self._robot(), sensor=sensor, how=how, size=_round(size))

    def _lie(self, when: _Fields) -> AnyFault:
        how: LieKind = self._pick("scaled", "offset", "garbage")
        factor = 1.2 * 3.0 ** self._rng.random()
        size = {
            "scaled": factor if self._rng.random() < 0.5 else 1.0 / factor,
            "offset": 0.03 * 100.0 ** self._rng.random(),
        }
        return Lie(**when, robot=self._robot(), how=how, size=_round(size.get(how, 1.0)))


def _for_ever(fault: AnyFault, duration: float) -> AnyFault:
    """A crash from which the agent does not come back; other faults as they are."""
    return (
        Crash(start=fault.start, end=duration, seed=fault.seed, robot=fault.robot)
        if isinstance(fault, Crash)
        else fault
    )


def _round(value: float) -> float:
    """What people can read."""
    return round(float(value), 3)


def _seed(rng: np.random.Generator) -> int:
    return int(rng.integers(2**32))
