"""What each process is told when it starts: nothing more than its part of the run needs."""

from __future__ import annotations

from typing import Any, Literal

import msgspec

from coheft.estimation.measurement import SensorNoise
from coheft.estimation.rigid_body.mass_properties import pack_symmetric
from coheft.estimation.tolerance import SensorDrift, SensorTolerance
from coheft.wire.former_names import keep_present
from coheft.wire.messages.size import LEAST_LIMIT
from coheft.wire.process.log import LogLevel
from coheft.wire.scenario.carry import Carry
from coheft.wire.scenario.estimator_settings import Converged, EfficientSettings, Fan2017Settings
from coheft.wire.scenario.grasps import place_grasps
from coheft.wire.scenario.schema import Motion, Scenario
from coheft.wire.scenario.waves import Waves, draw_waves
from coheft.wire.transport.security import Credentials

ClockKind = Literal["lockstep", "paced", "realtime"]


class Neighbour(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A robot at the other end of an edge; ``endpoint`` is where to dial it, None if it dials."""

    name: str
    endpoint: str | None


class KnownPayload(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """What a robot is told of the payload beforehand, in its own grasp frame ``F_i``; None: it is not told.

    Attributes:
        mass: [kg].
        com: Centre of mass [m].
        inertia: At the centre of mass, (xx, yy, zz, xy, xz, yz) [kg·m²].
    """

    mass: float | None = None
    com: tuple[float, float, float] | None = None
    inertia: tuple[float, float, float, float, float, float] | None = None


class AgentConfig(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """All that one agent knows when it starts. Not the team's size, not the graph, not the payload.

    Attributes:
        name: Its own name.
        neighbours: Those it can talk with.
        noise: Of its own sensors; its neighbours' are taken to be alike.
        noise_correlation: Time over which noise is alike [s].
        tolerance: How far its sensors may be off; its neighbours' are taken to be alike.
        drift: How far their constant errors wander.
        rate: Its sensors' samples per second.
        block: Samples per block.
        lag: Blocks from a measurement to the reference that answers it.
        seed: Of its own choice of motion, where it makes one.
        motion: What it may choose from.
        waves: What was drawn for it, for a motion that is made of sinusoids.
        estimator: Its method.
        fan2017: Settings of the estimator ``fan2017``.
        efficient: Settings of the estimator ``efficient``.
        estimator_settings: Of an estimator of the user's own.
        motion_settings: Of a motion of the user's own.
        converged: When its estimate is good enough.
        carry: Where to carry the load with the others, None: nowhere.
        known: What it is told of the payload, for the estimator ``fan2017``.
    """

    name: str
    neighbours: tuple[str, ...]
    noise: SensorNoise
    noise_correlation: float
    tolerance: SensorTolerance
    drift: SensorDrift
    rate: int
    block: int
    lag: int
    seed: int
    motion: Motion
    waves: Waves
    estimator: str
    fan2017: Fan2017Settings
    efficient: EfficientSettings
    estimator_settings: dict[str, Any]
    motion_settings: dict[str, Any]
    converged: Converged
    carry: Carry | None = None
    known: KnownPayload = KnownPayload()

    def __post_init__(self) -> None:
        keep_present(self)

    def blocks(self, duration: float) -> int:
        """Number of blocks nearest to a duration [s], at least one."""
        return max(1, round(duration * self.rate / self.block))

    def start_of(self, block: int) -> float:
        """Time of a block's first sample [s]."""
        return block * self.block / self.rate


class AgentProcessConfig(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """An agent and its links.

    Attributes:
        agent: The agent.
        run: Prefix of all keys of this run.
        server: Where to dial the server's link for this robot.
        listen: Where its neighbours dial it.
        observe: Where observers dial it.
        neighbours: Where to dial its neighbours.
        patience: How long after its measurements have come an agent waits for the message of a neighbour whose link
            stands [s]; it does not wait again for that one until it keeps pace again.
        server_limit: How long it waits for a server that is gone to come back [s].
        security: Its credentials; None: the open profile.
        largest_message: What a neighbour may send in one message [B].
        largest_arrays: What of it an estimator of the user's own may take for its arrays [B].
        log_level: What its log has at least.
    """

    agent: AgentConfig
    run: str
    server: str
    listen: str
    observe: str
    neighbours: tuple[Neighbour, ...]
    patience: float = 10.0
    server_limit: float = 30.0
    security: Credentials | None = None
    largest_message: int = LEAST_LIMIT
    largest_arrays: int = LEAST_LIMIT
    log_level: LogLevel = "info"


class ServerConfig(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """The physics server and its links.

    Attributes:
        scenario: What to simulate.
        run: Prefix of all keys of this run.
        robots: Where each robot dials in, by name: one link of its own per robot.
        observe: Where observers dial in.
        neighbours: The graph, for observers only.
        clock: ``lockstep`` waits for every agent, ``realtime`` for none; ``paced`` waits for every agent, and is no
            faster than the clock on the wall.
        save_data: File for what all robots measured, see ``coheft.wire.data.file``; None: nothing is kept.
        return_limit: How long lockstep waits for a robot whose link is lost to come back [s], and how long a run goes
            on after all robots are lost.
        security: Its credentials; None: the open profile.
        log_level: What its log has at least.
    """

    scenario: Scenario
    run: str
    robots: dict[str, str]
    observe: str
    neighbours: dict[str, tuple[str, ...]]
    clock: ClockKind = "lockstep"
    save_data: str | None = None
    return_limit: float = 10.0
    security: Credentials | None = None
    log_level: LogLevel = "info"


def agent_config(scenario: Scenario, name: str, neighbours: tuple[str, ...]) -> AgentConfig:
    """The agent's share of a scenario. Its seed is 1000 times the scenario's seed plus its own number, from 0."""
    seed = 1000 * scenario.seed + scenario.robot_names.index(name)
    return AgentConfig(
        name=name,
        neighbours=neighbours,
        noise=scenario.noise,
        noise_correlation=scenario.sensors.noise_correlation,
        tolerance=scenario.sensors.tolerance,
        drift=scenario.sensors.drift,
        rate=scenario.sensors.rate,
        block=scenario.sensors.block,
        lag=scenario.lookahead,
        seed=seed,
        motion=scenario.motion,
        waves=draw_waves(scenario.motion.frequency, seed),
        estimator=scenario.estimator,
        fan2017=scenario.fan2017,
        efficient=scenario.efficient,
        estimator_settings=scenario.settings.get(scenario.estimator, {}),
        motion_settings=scenario.settings.get(scenario.motion.own or "", {}),
        converged=scenario.converged,
        carry=scenario.carry,
        known=_known(scenario, name),
    )


def _known(scenario: Scenario, name: str) -> KnownPayload:
    """What ``fan2017.known`` says that robots are told, as one of them sees it."""
    parts = scenario.fan2017.known
    if not parts:
        return KnownPayload()
    grasp = place_grasps(scenario)[scenario.robot_names.index(name)]
    seen = scenario.payload.inertia().carried(grasp.inverse())
    told = {"mass": seen.mass, "com": seen.com.tolist(), "inertia": pack_symmetric(seen.tensor).tolist()}
    return msgspec.convert({part: told[part] for part in parts}, KnownPayload)
