"""Scenarios: payload, robots, links, sensors, motions and events; ``file`` reads them from TOML."""

from typing import Annotated, Any, Literal, get_args

import numpy as np
from msgspec import Meta, field

from coheft.estimation.geometry.spatial import Pose, rotation_from_quaternion
from coheft.estimation.measurement import Positive, SensorNoise
from coheft.estimation.tolerance import INDUSTRIAL, SensorDrift, SensorTolerance
from coheft.wire.former_names import keep_present
from coheft.wire.scenario.encoders import EncoderErrors
from coheft.wire.scenario.estimator_settings import Converged, EfficientSettings, Fan2017Settings
from coheft.wire.scenario.motion import Carry, Motion
from coheft.wire.scenario.network import LinkQuality
from coheft.wire.scenario.payload import Payload
from coheft.wire.scenario.robot_sensors import OtherSensors, RobotSensors
from coheft.wire.scenario.section import Lengths, Name, Names, NotNegative, Section, Seed, Vector, pose_of

GraphKind = Literal["ring", "line", "star", "grid", "tree", "complete", "random"]
SensorRate = Literal[100, 125, 200, 250, 500, 1000]
SENSOR_RATES: tuple[int, ...] = get_args(SensorRate)
PHYSICS_RATE = 1000
"""Physics steps per second."""
MAX_ROBOTS = 1024
"""Limit far above what one machine can run, so that a number in a file cannot fill the memory."""
SlipLength = Annotated[float, Meta(ge=-0.1, le=0.1)]
SlipAngle = Annotated[float, Meta(ge=-10, le=10)]
MAX_DURATION = 1e7
"""Longest run [s]: four months."""


class Grasp(Section, frozen=True):
    """Grasp of one robot.

    Attributes:
        position: Position of the grasp frame's origin in the payload's frame [m]. It may be outside the payload by at
            most the payload's length, or 0.3 m.
        rotation_deg: Rotation vector of the grasp frame in the payload's frame [degrees].
    """

    position: Vector
    rotation_deg: Vector = (0.0, 0.0, 0.0)

    def pose(self) -> Pose:
        """Return the pose of ``F_i`` in the payload's frame."""
        return pose_of(self.position, self.rotation_deg)


class Perimeter(Section, frozen=True):
    """Grasps spread over the rim of a rectangle around the payload, each at a random orientation and height.

    Attributes:
        count: Number of robots.
        extent: Edge lengths of the rectangle [m].
        height: Grasps lie within this height above or below the payload's middle [m].
        seed: Seed of the random orientations and heights.
    """

    count: Annotated[int, Meta(ge=2, le=MAX_ROBOTS)]
    extent: tuple[Positive, Positive]
    height: NotNegative = 0.05
    seed: Seed = 0


class Robots(Section, frozen=True):
    """The robots: their grasps (listed, spread over a rim, or sites of a model) and the impedance of their arms.

    Attributes:
        grasps: Grasps, one per robot.
        perimeter: Instead of grasps: a rule that places them.
        sites: Instead of grasps: names of sites of the model ``payload.mjcf``, one per robot; grasp frames have the
            orientations of the sites.
        stiffness: Stiffness of every arm: translation [N/m], rotation [N·m/rad]. Without stiffness and damping in
            rotation the wrist is a gimbal: its torque is exactly zero.
        damping: Damping of every arm: translation [N·s/m], rotation [N·m·s/rad].
        arms: ``springs`` have only this impedance; ``seven-joint`` arms are torque-controlled to have it, and their
            hands are welded to the payload. The z axes of their grasps point out of the hands.
    """

    grasps: Annotated[tuple[Grasp, ...], Meta(max_length=MAX_ROBOTS)] = ()
    perimeter: Perimeter | None = None
    sites: Annotated[tuple[str, ...], Meta(max_length=MAX_ROBOTS)] = ()
    stiffness: tuple[Positive, NotNegative] = (800.0, 30.0)
    damping: tuple[NotNegative, NotNegative] = (70.0, 3.0)
    arms: Literal["springs", "seven-joint"] = "springs"

    def poses(self) -> tuple[Pose, ...]:
        """Return the true pose of each robot's grasp frame ``F_i`` in the payload's frame, in order of names."""
        if self.perimeter is None:
            return tuple(grasp.pose() for grasp in self.grasps)
        # At equal distances along the rim, counter-clockwise, with uniformly distributed orientations.
        rng, (width, depth) = np.random.default_rng(self.perimeter.seed), self.perimeter.extent
        corners = np.array([[-width, -depth], [width, -depth], [width, depth], [-width, depth], [-width, -depth]]) / 2.0
        along = np.cumsum([0.0, width, depth, width, depth])
        poses = []
        for distance in (np.arange(self.perimeter.count) + 0.5) / self.perimeter.count * 2.0 * (width + depth):
            x, y = (np.interp(distance, along, corners[:, axis]) for axis in (0, 1))
            quaternion = rng.standard_normal(4)
            height = rng.uniform(-self.perimeter.height, self.perimeter.height)
            rotation = rotation_from_quaternion(quaternion / np.linalg.norm(quaternion))
            poses.append(Pose(rotation, np.array([x, y, height])))
        return tuple(poses)


class Graph(Section, frozen=True):
    """Links between robots.

    Attributes:
        kind: Shape of the graph; ``grid`` is as square as possible, ``tree`` branches from the first robot, ``random``
            is a random connected graph.
        branches: Branches of every robot, away from the first, for ``tree``.
        edge_probability: Probability of each edge beyond a random spanning tree, for ``random``.
        seed: Seed of the random graph, for ``random``.
    """

    kind: GraphKind = "ring"
    branches: Annotated[int, Meta(ge=1, le=64)] = 4
    edge_probability: Annotated[float, Meta(ge=0, le=1)] = 0.2
    seed: Seed = 0


class Sensors(Section, frozen=True):
    """Sampling and errors of the sensors.

    Attributes:
        rate: Samples per second; must divide 1000.
        block: Samples per message.
        noise: Standard deviations per sample; times ``noise_scale`` at least a thousandth of the default.
        noise_scale: Factor for all of ``noise``. Must not be 0, because estimators weight samples by their noise.
        noise_correlation: Correlation time of the noise [s]; 0 for white noise.
        tolerance: One standard deviation of each sensor error, not a limit. The robots know it, and estimate all errors
            for which it is not 0. By default those of a good industrial arm; ``{}`` means exact sensors.
        drift: How far constant errors drift within a minute, known to the robots.
        errors: True errors: ``drawn`` from the tolerance and the drift, ``none``, or drawn from other standard
            deviations, which the robots do not know; then they do not drift.
        encoders: Errors of poses and forces in recordings. By default recordings hold the sensors' samples.
        of: Robots whose noise or tolerances differ, known to all robots.
    """

    rate: SensorRate = 500
    block: Annotated[int, Meta(ge=2, le=200)] = 10
    noise: SensorNoise = SensorNoise()
    noise_scale: Positive = 1.0
    noise_correlation: Annotated[float, Meta(ge=0, le=1)] = 0.0
    tolerance: SensorTolerance = INDUSTRIAL
    drift: SensorDrift = SensorDrift()
    errors: Literal["drawn", "none"] | SensorTolerance = "drawn"
    encoders: EncoderErrors | None = None
    of: Annotated[tuple[OtherSensors, ...], Meta(max_length=MAX_ROBOTS)] = ()

    def unequal(self) -> dict[str, RobotSensors]:
        """Return the sensors of the robots that differ, by name."""
        return {each.robot: each.on(self.noise, self.noise_scale, self.tolerance) for each in self.of}


class LoadChange(Section, frozen=True):
    """A load put onto the payload, or taken away, at a given time. Loads that are too heavy for the arms are refused.

    Attributes:
        at: Time [s]; takes effect at the next start of a block.
        mass: Mass of the new load [kg].
        position: Position of its centre in the payload's frame [m]. It may be outside the payload by at most the
            payload's length, or 0.3 m (ten times that if only mass properties are known).
        size: Edge lengths of the load [m]; at most the payload's length plus that margin on both sides.
        leak: Mass that it loses per second from then on, until nothing is left [kg/s].
        remove: Instead: number of the load to take away; loads are numbered from 1 in order of arrival.
    """

    at: NotNegative
    mass: Positive | None = None
    position: Vector = (0.0, 0.0, 0.0)
    size: Lengths = (0.1, 0.1, 0.1)
    leak: NotNegative = 0.0
    remove: Annotated[int, Meta(ge=1)] | None = None


class Slip(Section, frozen=True):
    """A slip of a grasp: from then on the robot holds the payload at another place, without being informed.

    Attributes:
        at: Time [s]; takes effect at the next start of a block.
        robot: Name of the robot.
        translation: Displacement of its grasp frame, in its own axes [m]; at most 0.1 m along each.
        rotation_deg: Rotation of its grasp frame, rotation vector in its own axes [degrees]; at most 10° about each.
    """

    at: NotNegative
    robot: Name
    translation: tuple[SlipLength, SlipLength, SlipLength] = (0.0, 0.0, 0.0)
    rotation_deg: tuple[SlipAngle, SlipAngle, SlipAngle] = (0.0, 0.0, 0.0)

    def pose(self) -> Pose:
        """Return the pose of the new grasp frame in the previous one."""
        return pose_of(self.translation, self.rotation_deg)


class Scenario(Section, frozen=True):
    """Everything that defines a run. Two runs of equal scenarios in lockstep give identical numbers.

    Attributes:
        name: Name of the scenario.
        description: One line that describes it.
        payload: The payload.
        robots: The robots that hold it.
        graph: Which robots are linked.
        network: Loss and delay of messages on all links, see ``coheft.agents.network``.
        sensors: Sampling and errors of the sensors.
        motion: Motion of each robot.
        carry: A common path along which the robots carry the payload.
        load_changes: Changes of the load during the run.
        slips: Slips of grasps during the run.
        duration: Length of the run [s].
        seed: Seed of sensor noise, sensor errors and motions.
        estimator: Estimator of the agents: ``efficient``, ``fan2017``, or one of your own, see docs/own.md. Several
            with commas between them run side by side; the first is the robots' own.
        fan2017: Settings of the estimator ``fan2017``.
        efficient: Settings of the estimator ``efficient``.
        settings: Settings of your own estimator and motion, one table each, ``settings.NAME``.
        converged: When an estimate counts as converged.
        lookahead: Number of blocks that the server may run ahead of the slowest agent; also the delay of references.
    """

    name: Name
    payload: Payload
    robots: Robots
    description: str = ""
    graph: Graph = Graph()
    network: LinkQuality = LinkQuality()
    sensors: Sensors = Sensors()
    motion: Motion = Motion()
    carry: Carry | None = None
    load_changes: tuple[LoadChange, ...] = ()
    slips: tuple[Slip, ...] = ()
    duration: Annotated[float, Meta(gt=0, le=MAX_DURATION)] = 30.0
    seed: Seed = 1
    estimator: Names = "efficient"
    fan2017: Fan2017Settings = Fan2017Settings()
    efficient: EfficientSettings = EfficientSettings()
    settings: dict[str, dict[str, Any]] = field(default_factory=dict)
    converged: Converged = Converged()
    lookahead: Annotated[int, Meta(ge=1, le=64)] = 4

    def __post_init__(self) -> None:
        keep_present(self)

    @property
    def block_duration(self) -> float:
        """Duration of a block [s]."""
        return self.sensors.block / self.sensors.rate

    @property
    def blocks(self) -> int:
        """Number of blocks of the run."""
        return max(1, round(self.duration / self.block_duration))

    @property
    def noise(self) -> SensorNoise:
        """The noise of all robots' sensors but those in ``sensors.of``, including the factor ``noise_scale``."""
        return self.sensors.noise.scaled(self.sensors.noise_scale)

    def robot_sensors(self) -> list[RobotSensors]:
        """Return the sensors of each robot."""
        unequal, alike = self.sensors.unequal(), RobotSensors(self.noise, self.sensors.tolerance)
        return [unequal.get(name, alike) for name in self.robot_names]

    @property
    def sensor_errors(self) -> SensorTolerance:
        """Standard deviations from which true errors are drawn, of all robots' sensors but those in ``sensors.of``."""
        errors = self.sensors.errors
        if isinstance(errors, SensorTolerance):
            return errors
        return self.sensors.tolerance if errors == "drawn" else SensorTolerance()

    def robot_errors(self) -> list[SensorTolerance]:
        """Return standard deviations from which the true errors of each robot's sensors are drawn."""
        if self.sensors.errors == "drawn":
            return [each.tolerance for each in self.robot_sensors()]
        return [self.sensor_errors] * self.robot_count

    @property
    def sensor_drift(self) -> SensorDrift:
        """True drift of the sensors' errors."""
        return self.sensors.drift if self.sensors.errors == "drawn" else SensorDrift()

    @property
    def robot_count(self) -> int:
        """Number of robots."""
        perimeter = self.robots.perimeter
        return perimeter.count if perimeter is not None else len(self.robots.grasps)

    @property
    def robot_names(self) -> tuple[str, ...]:
        """``r1``, ``r2``, …, with enough digits that alphabetical order is numerical order."""
        digits = len(str(self.robot_count))
        return tuple(f"r{i + 1:0{digits}d}" for i in range(self.robot_count))
