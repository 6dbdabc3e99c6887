"""Scenarios: what is held, by whom, how they talk, what happens. ``scenario_file`` reads them from TOML."""

from __future__ import annotations

from typing import Annotated, Any, Literal

import msgspec
import numpy as np
from msgspec import Meta

from coheft.estimation.measurement import Positive, SensorNoise
from coheft.estimation.rigid_body import Inertia, combined
from coheft.estimation.spatial import Pose, rotation_exp
from coheft.wire.carry import Carry
from coheft.wire.encoders import EncoderErrors
from coheft.wire.via_points import ViaPoints

PHYSICS_RATE = 1000
"""Physics steps per second."""
MAX_ROBOTS = 256
"""Far more than one machine can serve; a bound, so that no number in a file can fill the memory."""
MAX_DURATION = 1e7
"""Longest run [s]: four months."""

Vector = tuple[float, float, float]
NotNegative = Annotated[float, Meta(ge=0)]
Seed = Annotated[int, Meta(ge=0, lt=2**32)]
Name = Annotated[str, Meta(pattern=r"^[a-z][a-z0-9_-]{0,31}\Z")]
Lengths = tuple[Positive, Positive, Positive]


class Section(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Base of all parts of a scenario: unknown keys are errors."""


class Box(Section, frozen=True):
    """A homogeneous box of the payload.

    Attributes:
        mass: Its mass [kg].
        size: Its edge lengths [m].
        position: Of its centre in the payload's frame [m].
        rotation_deg: Of its edges against the payload's axes, rotation vector [degrees].
    """

    mass: Positive
    size: Lengths
    position: Vector = (0.0, 0.0, 0.0)
    rotation_deg: Vector = (0.0, 0.0, 0.0)

    def pose(self) -> Pose:
        """Pose of the box in the payload's frame."""
        return pose_of(self.position, self.rotation_deg)

    def inertia(self) -> Inertia:
        """Its mass properties in the payload's frame."""
        return Inertia.of_box(self.mass, self.size, self.pose())


class MassProperties(Section, frozen=True):
    """A payload of which no more is known than how it moves.

    Attributes:
        mass: [kg].
        com: Centre of mass in the payload's frame [m].
        principal: Principal moments of inertia at the centre of mass [kg·m²].
        axes_deg: Rotation vector from the payload's axes to the principal ones [degrees].
    """

    mass: Positive
    com: Vector
    principal: Lengths
    axes_deg: Vector = (0.0, 0.0, 0.0)

    def inertia(self) -> Inertia:
        """The same in the payload's frame."""
        at_com = Inertia(self.mass, np.zeros(3), np.diag(np.array(self.principal, dtype=np.float64)))
        return at_com.carried(pose_of(self.com, self.axes_deg))


class Payload(Section, frozen=True):
    """The thing that is held: boxes fixed to each other, mere mass properties, or a file of your own.

    Files are read when the scenario is, see ``payload_file``: what is left of them are mass properties. Their paths are
    relative to the scenario's file.

    Attributes:
        boxes: What it is made of, fixed to each other.
        properties: Instead: what it weighs.
        mjcf: Instead: MuJoCo model, of which one body is held. The payload's frame is the frame of that body.
        body: Name of that body, if the model has several.
        mesh: Instead: its closed surface, an STL (binary), OBJ or MSH file, homogeneous inside. The payload's frame is
            the frame of the mesh.
        density: Of the mesh [kg/m³].
        mass: Of the mesh, instead of its density [kg].
        scale: Length of the mesh's unit [m]: 0.001 if it was drawn in millimetres.
        load_slots: Number of loads that can lie on it at a time.
    """

    boxes: tuple[Box, ...] = ()
    properties: MassProperties | None = None
    mjcf: str | None = None
    body: str | None = None
    mesh: str | None = None
    density: Positive | None = None
    mass: Positive | None = None
    scale: Positive = 1.0
    load_slots: Annotated[int, Meta(ge=0, le=64)] = 4

    def inertia(self) -> Inertia:
        """Mass properties in the payload's frame, without loads."""
        return self.properties.inertia() if self.properties else combined(box.inertia() for box in self.boxes)


class Grasp(Section, frozen=True):
    """Where one robot holds the payload.

    Attributes:
        position: Of its grasp frame's origin in the payload's frame [m].
        rotation_deg: Of its grasp frame against the payload's, rotation vector [degrees].
    """

    position: Vector
    rotation_deg: Vector = (0.0, 0.0, 0.0)

    def pose(self) -> Pose:
        """Pose of ``F_i`` in the payload's frame."""
        return pose_of(self.position, self.rotation_deg)


class Perimeter(Section, frozen=True):
    """Grasps spread over the rim of a rectangle around the payload, each at a random orientation and height.

    Attributes:
        count: Number of robots.
        extent: Edge lengths of the rectangle [m].
        height: Grasps lie within plus or minus this of the payload's middle [m].
        seed: Of the random orientations and heights.
    """

    count: Annotated[int, Meta(ge=2, le=MAX_ROBOTS)]
    extent: tuple[Positive, Positive]
    height: NotNegative = 0.05
    seed: Seed = 0


class Robots(Section, frozen=True):
    """The robots: their grasps (listed, spread over a rim, or sites of a model) and the impedance of their arms.

    Attributes:
        grasps: One per robot.
        perimeter: Instead: a rule that places them.
        sites: Instead: names of sites of the model ``payload.mjcf``, one per robot; grasp frames are oriented as the
            sites are.
        stiffness: Of every arm: translation [N/m], rotation [N·m/rad]. Without stiffness and damping in rotation the
            wrist is a gimbal: its torque is exactly zero.
        damping: Of every arm: translation [N·s/m], rotation [N·m·s/rad].
        arms: ``springs`` are nothing but that; ``seven-joint`` arms are driven by their joints' torques so that their
            hands, which are welded to the payload, behave like it. The z axes of their grasps point out of the hands.
    """

    grasps: Annotated[tuple[Grasp, ...], Meta(max_length=MAX_ROBOTS)] = ()
    perimeter: Perimeter | None = None
    sites: Annotated[tuple[str, ...], Meta(max_length=MAX_ROBOTS)] = ()
    stiffness: tuple[Positive, NotNegative] = (800.0, 30.0)
    damping: tuple[NotNegative, NotNegative] = (70.0, 3.0)
    arms: Literal["springs", "seven-joint"] = "springs"


class Graph(Section, frozen=True):
    """Who talks with whom.

    Attributes:
        kind: Its shape; ``random`` is a random connected graph.
        edge_probability: Of each edge beyond a random spanning tree, for ``random``.
        seed: Of the random graph, for ``random``.
    """

    kind: Literal["ring", "line", "star", "complete", "random"] = "ring"
    edge_probability: Annotated[float, Meta(ge=0, le=1)] = 0.2
    seed: Seed = 0


class SensorOffset(Section, frozen=True):
    """Size of constant sensor errors: each axis of each robot draws its own, uniform in plus or minus this.

    Attributes:
        gyro: Of the angular velocity [rad/s].
        velocity: Of the velocity [m/s].
        acceleration: Of the acceleration [m/s²].
        force: Of the force [N].
        torque: Of the torque [N·m].
    """

    gyro: NotNegative = 0.0
    velocity: NotNegative = 0.0
    acceleration: NotNegative = 0.0
    force: NotNegative = 0.0
    torque: NotNegative = 0.0


class Sensors(Section, frozen=True):
    """Sampling and errors of the sensors.

    Attributes:
        rate: Samples per second; must divide 1000.
        block: Samples that travel in one message.
        noise: Standard deviations per sample.
        noise_scale: Multiplies all of ``noise``. A file cannot say 0: estimators weigh samples by their noise.
        offset: Constant errors.
        encoders: How exactly recordings tell the wrists' poses and forces. Without it they hold the sensors' samples.
    """

    rate: Literal[100, 125, 200, 250, 500, 1000] = 500
    block: Annotated[int, Meta(ge=2, le=200)] = 10
    noise: SensorNoise = SensorNoise()
    noise_scale: Positive = 1.0
    offset: SensorOffset = SensorOffset()
    encoders: EncoderErrors | None = None


class Motion(Section, frozen=True):
    """Reference motion of every robot, drawn by each robot alone: two sinusoids per axis, via points, or your own.

    Attributes:
        translation: Amplitude per axis [m].
        rotation: Amplitude per axis [rad].
        frequency: Range from which frequencies are drawn [Hz].
        ramp: Time from rest to full amplitude [s].
        axes: Share of the amplitude per axis of the robot's home frame: rotation about x, y, z, translation along them.
        via_points: Instead of sinusoids: random points, and straight lines between them.
        own: Instead: a motion of your own, by its name, see docs/own.md.
    """

    translation: NotNegative = 0.06
    rotation: NotNegative = 0.2
    frequency: tuple[Positive, Positive] = (0.4, 1.6)
    ramp: NotNegative = 2.0
    axes: tuple[NotNegative, NotNegative, NotNegative, NotNegative, NotNegative, NotNegative] = (1.0,) * 6
    via_points: ViaPoints | None = None
    own: Name | None = None


class LoadChange(Section, frozen=True):
    """A load put onto the payload, or taken away, at a given time.

    Attributes:
        at: Time [s]; takes effect at the next border of a block.
        mass: Of the new load [kg].
        position: Of its centre in the payload's frame [m].
        size: Its edge lengths [m].
        leak: What it loses from then on [kg/s], until nothing is left.
        remove: Instead: number of the load to take away; loads are numbered from 1 as they come.
    """

    at: NotNegative
    mass: Positive | None = None
    position: Vector = (0.0, 0.0, 0.0)
    size: Lengths = (0.1, 0.1, 0.1)
    leak: NotNegative = 0.0
    remove: Annotated[int, Meta(ge=1)] | None = None


class SeedSettings(Section, frozen=True):
    """The seed paper's method, see ``agents.seed``.

    Attributes:
        memory: Time over which old samples are forgotten [s]; the forgetting factor per sample is
            ``1 - 1 / (memory * rate)``.
        rounds: Rounds of dynamic consensus that each sample goes through.
        pose_rotation_deg: Largest standard deviation of a pose's rotation for it to have converged [degrees].
        pose_translation_mm: And of its translation [mm].
    """

    memory: Positive = 2.0
    rounds: Annotated[int, Meta(ge=1, le=256)] = 16
    pose_rotation_deg: Positive = 0.06
    pose_translation_mm: Positive = 1.2


class EfficientSettings(Section, frozen=True):
    """The method at the Cramér-Rao bound, see ``agents.efficient``.

    Attributes:
        start_rotation_deg: The search for better poses starts when all poses on a spanning tree are known to this
            [degrees]; what it sums is not kept.
        start_translation_mm: And to this [mm].
        refit_share: Poses are fitted anew whenever the data have grown by this share.
        offsets: Whether force and torque sensors may have constant offsets; these are then estimated as well.
        memory: How long the past counts: "window" keeps all since the last load change that was noticed; a number
            forgets exponentially over this time [s].
    """

    start_rotation_deg: Positive = 1.0
    start_translation_mm: Positive = 20.0
    refit_share: Positive = 0.01
    offsets: bool = False
    memory: Literal["window"] | Positive = "window"


class Converged(Section, frozen=True):
    """An agent calls its estimate converged when all standard deviations are below these.

    Attributes:
        mass_percent: Of the mass, relative [%].
        com_mm: Of each coordinate of the centre of mass [mm].
        inertia_percent: Of the inertia, Frobenius norm relative to its own [%].
    """

    mass_percent: Positive = 1.0
    com_mm: Positive = 7.0
    inertia_percent: Positive = 5.0


class Scenario(Section, frozen=True):
    """Everything that defines a run. Two runs of equal scenarios in lockstep give identical numbers.

    Attributes:
        name: Name of the scenario.
        description: One line for people.
        payload: What is held.
        robots: Who holds it.
        graph: Who talks with whom.
        sensors: How well each robot measures.
        motion: How each robot moves.
        carry: A common path along which they carry the payload.
        load_changes: What happens to the payload.
        duration: Length of the run [s].
        seed: Of the sensors' noise and offsets and of the robots' choice of motion.
        estimator: Which method the agents use: ``efficient``, ``seed``, or one of your own, see docs/own.md.
        seed_method: Settings of the estimator ``seed``.
        efficient: Settings of the estimator ``efficient``.
        settings: Of estimators and motions of your own, a table each, ``settings.NAME``.
        converged: When an estimate is good enough.
        lookahead: Blocks that the server may run ahead of the slowest agent; also the lag of references.
    """

    name: Name
    payload: Payload
    robots: Robots
    description: str = ""
    graph: Graph = Graph()
    sensors: Sensors = Sensors()
    motion: Motion = Motion()
    carry: Carry | None = None
    load_changes: tuple[LoadChange, ...] = ()
    duration: Annotated[float, Meta(gt=0, le=MAX_DURATION)] = 30.0
    seed: Seed = 1
    estimator: Name = "efficient"
    seed_method: SeedSettings = SeedSettings()
    efficient: EfficientSettings = EfficientSettings()
    settings: dict[str, dict[str, Any]] = {}
    converged: Converged = Converged()
    lookahead: Annotated[int, Meta(ge=1, le=64)] = 4

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
        """The sensors' noise, scale included."""
        return self.sensors.noise.scaled(self.sensors.noise_scale)

    @property
    def robot_count(self) -> int:
        """Number of robots."""
        perimeter = self.robots.perimeter
        return perimeter.count if perimeter is not None else len(self.robots.grasps)

    @property
    def robot_names(self) -> tuple[str, ...]:
        """``r1``, ``r2``, …, as many digits as needed for alphabetical order to be the numbers' order."""
        digits = len(str(self.robot_count))
        return tuple(f"r{i + 1:0{digits}d}" for i in range(self.robot_count))


def pose_of(position: Vector, rotation_deg: Vector) -> Pose:
    """Pose from a position [m] and a rotation vector [degrees]."""
    return Pose(rotation_exp(np.radians(rotation_deg)), np.array(position, dtype=np.float64))
