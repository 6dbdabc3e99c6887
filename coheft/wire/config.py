"""Configurations of processes: each contains only what the process needs for its part of the run."""

from typing import Any, Literal

import msgspec

from coheft.estimation.measurement import SensorNoise
from coheft.estimation.rigid_body.mass_properties import pack_symmetric
from coheft.estimation.tolerance import SensorDrift, SensorTolerance
from coheft.wire.former_names import keep_present
from coheft.wire.messages.size import LEAST_LIMIT
from coheft.wire.process.log import LogLevel
from coheft.wire.scenario.estimator_settings import Converged, EfficientSettings, Fan2017Settings
from coheft.wire.scenario.motion import Carry, Motion, Waves, draw_waves
from coheft.wire.scenario.network import LinkQuality
from coheft.wire.scenario.plugins import estimator_names
from coheft.wire.scenario.robot_sensors import RobotSensors
from coheft.wire.scenario.schema import Scenario
from coheft.wire.transport.security import Credentials

ClockKind = Literal["lockstep", "paced", "realtime"]


class Neighbour(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A robot at the other end of an edge; ``endpoint`` is the address to dial, None if the neighbour dials."""

    name: str
    endpoint: str | None


class KnownPayload(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Payload parameters that a robot knows at the start, in its own grasp frame ``F_i``; None if unknown.

    Attributes:
        mass: Mass [kg].
        com: Centre of mass [m].
        inertia: Inertia about the centre of mass, (xx, yy, zz, xy, xz, yz) [kg·m²].
    """

    mass: float | None = None
    com: tuple[float, float, float] | None = None
    inertia: tuple[float, float, float, float, float, float] | None = None


class AgentConfig(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """All that one agent knows at the start. It includes neither the team's size, nor the graph, nor the payload.

    What is not listed here is as in the scenario, see ``Scenario`` and ``Sensors``.

    Attributes:
        noise, tolerance: Those of all robots' sensors but the ones in ``unequal``.
        unequal: Sensors of the robots that differ, by name; its own may be among them.
        lag: Number of blocks from a measurement to the reference that answers it.
        seed: Seed of its own random choice of a motion.
        waves: The sinusoids that were drawn for it, used by motions that are made of sinusoids.
        estimator_settings: Settings of users' estimators by name; the estimator itself gets only its own.
        motion_settings: Settings of a user's motion.
        known: Payload parameters that it knows at the start, for the estimator ``fan2017``.
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
    network: LinkQuality = LinkQuality()
    unequal: dict[str, RobotSensors] = {}

    def sensors_of(self, robot: str) -> RobotSensors:
        """Return the sensors of a robot, as this one knows them."""
        return self.unequal.get(robot, RobotSensors(self.noise, self.tolerance))

    def __post_init__(self) -> None:
        keep_present(self)

    def blocks(self, duration: float) -> int:
        """Return the number of blocks nearest to a duration [s], at least one."""
        return max(1, round(duration * self.rate / self.block))

    def start_of(self, block: int) -> float:
        """Return the time of a block's first sample [s]."""
        return block * self.block / self.rate


class ProcessConfig(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """What the configurations of all processes of a run have.

    Attributes:
        run: Prefix of all keys of this run.
        observe: Endpoint at which observers dial.
        security: Credentials of the process; None for the open profile.
        log_level: The lowest level of messages in its log.
    """

    run: str
    observe: str
    security: Credentials | None = None
    log_level: LogLevel = "info"


class AgentProcessConfig(ProcessConfig, frozen=True, kw_only=True):
    """Configuration of an agent's process.

    Attributes:
        server: Endpoint of the server for this robot, to dial.
        listen: Endpoint at which neighbours dial this agent.
        patience: Time after its measurements for which the agent waits for the message of a neighbour whose link is up
            [s]; it does not wait again for that neighbour until it keeps pace again.
        server_limit: Time for which it waits for a lost server to return [s].
        largest_message: Size of the largest message of a neighbour [B].
        largest_arrays: Size that a user's estimator may use of it for its arrays [B].
    """

    agent: AgentConfig
    server: str
    listen: str
    neighbours: tuple[Neighbour, ...]
    patience: float = 10.0
    server_limit: float = 30.0
    largest_message: int = LEAST_LIMIT
    largest_arrays: int = LEAST_LIMIT


class ServerConfig(ProcessConfig, frozen=True, kw_only=True):
    """Configuration of the physics server's process.

    Attributes:
        robots: Endpoint at which each robot dials, by name: each has a separate link.
        neighbours: The graph, for observers only.
        clock: ``lockstep`` waits for every agent, ``realtime`` for none; ``paced`` waits for every agent, and is not
            faster than real time.
        save_data: File for all robots' measurements, see ``coheft.wire.data.file``; None for none.
        return_limit: Time for which the run waits for a lost robot to return, except in real time, and for which it
            continues after all robots are lost [s].
    """

    scenario: Scenario
    robots: dict[str, str]
    neighbours: dict[str, tuple[str, ...]]
    clock: ClockKind = "lockstep"
    save_data: str | None = None
    return_limit: float = 10.0


def agent_config(scenario: Scenario, name: str, neighbours: tuple[str, ...]) -> AgentConfig:
    """Return an agent's configuration. Its seed is 1000 times the scenario's seed plus its own number, from 0."""
    seed, sensors = 1000 * scenario.seed + scenario.robot_names.index(name), scenario.sensors
    same = ("motion", "estimator", "fan2017", "efficient", "converged", "carry", "network")
    same_of_sensors = ("noise_correlation", "tolerance", "drift", "rate", "block")
    return AgentConfig(
        name=name,
        neighbours=neighbours,
        noise=scenario.noise,
        lag=scenario.lookahead,
        seed=seed,
        waves=draw_waves(scenario.motion.frequency, seed),
        estimator_settings={name: scenario.settings.get(name, {}) for name in estimator_names(scenario.estimator)},
        motion_settings=scenario.settings.get(scenario.motion.own or "", {}),
        known=_known(scenario, name),
        unequal=sensors.unequal(),
        **{key: getattr(scenario, key) for key in same},
        **{key: getattr(sensors, key) for key in same_of_sensors},
    )


def _known(scenario: Scenario, name: str) -> KnownPayload:
    """Return the payload parameters that ``fan2017.known`` names, in the robot's grasp frame."""
    parts = scenario.fan2017.known
    if not parts:
        return KnownPayload()
    grasp = scenario.robots.poses()[scenario.robot_names.index(name)]
    seen = scenario.payload.inertia().transported(grasp.inverse())
    told = {"mass": seen.mass, "com": seen.com.tolist(), "inertia": pack_symmetric(seen.tensor).tolist()}
    return msgspec.convert({part: told[part] for part in parts}, KnownPayload)
