"""The simulation: payload, arms, sensors and loads, advanced by one block of samples at a time."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import compress
from typing import TYPE_CHECKING

import mujoco
import numpy as np

from coheft.errors import LoadError, SimulationError, one_line
from coheft.estimation.geometry.spatial import Array
from coheft.estimation.measurement import ACCELERATION, WRENCH
from coheft.physics_server.arms.impedance import Arms
from coheft.physics_server.arms.torque_control import TorqueArms
from coheft.physics_server.grasps import Grasps
from coheft.physics_server.held import check_controls, check_held
from coheft.physics_server.loads import Loads
from coheft.physics_server.scene import PAYLOAD, PAYLOAD_HOME, build_model, home_name
from coheft.physics_server.sensor_errors import SensorErrors
from coheft.physics_server.sensors import LATEST, READINGS, Sensors
from coheft.physics_server.stepping import step
from coheft.wire.messages.structs import Measurements, Reference
from coheft.wire.messages.truth import BoxShape, LoadState, PayloadTruth, Scene, Truth
from coheft.wire.process.log import LOG
from coheft.wire.scenario.arm_checks import stability_complaints
from coheft.wire.scenario.borders import by_border
from coheft.wire.scenario.change_checks import load_complaints
from coheft.wire.scenario.payload import vector_of
from coheft.wire.scenario.payload_surface import from_text
from coheft.wire.scenario.rules import check
from coheft.wire.scenario.schema import PHYSICS_RATE, Scenario
from coheft.wire.scenario.section import Vector
from coheft.wire.scenario.strength import SETTLING_TIME, Strength

if TYPE_CHECKING:
    from coheft.physics_server.arms.encoders import Encoders


@dataclass(frozen=True, eq=False)
class BlockResult:
    """One simulated block.

    Attributes:
        measurements: Measurements of each robot, by name.
        truth: The true state, which no robot knows.
        problems: Load changes of the scenario that could not be made at the start of this block, with reasons.
        wrists: Readings of encoders and drives, see ``Encoders.measure``, for recordings only; None if the scenario has
            no encoders.
    """

    measurements: dict[str, Measurements]
    truth: Truth
    problems: tuple[str, ...] = ()
    wrists: Array | None = None


class Simulation:
    """A payload held by N robots.

    The same scenario, references and calls between blocks give the same numbers, bit for bit.

    Attributes:
        scene: The robots, their grasps and the payload's shape.
        block: Index of the next block.
        loads: The loads on the payload.
        model, data: The engine's model and state, for views.
    """

    def __init__(self, scenario: Scenario, neighbours: Mapping[str, Sequence[str]] | None = None) -> None:
        """Build the scene, with the payload at rest where the robots hold it; the graph is for ``scene`` only.

        Raises:
            ScenarioError: The scenario's load changes cannot all be made, or its arms are too stiff for its payload.
        """
        grasps = scenario.robots.poses()
        check(scenario, scenario.name, stability_complaints, load_complaints)
        names = scenario.robot_names
        self._scenario = scenario
        self._names = names
        self.scene = Scene(
            robots=list(names),
            rotations=np.array([grasp.rotation for grasp in grasps]),
            translations=np.array([grasp.translation for grasp in grasps]),
            neighbours={name: list(others) for name, others in (neighbours or {}).items()},
            triangles=from_text(scenario.payload.surface),
            boxes=[BoxShape(box.size, box.position, box.rotation_deg) for box in scenario.payload.boxes],
            home=vector_of(PAYLOAD_HOME.translation),
        )
        self.block = 0
        if mujoco.get_mju_user_warning() is None:  # by default MuJoCo writes a file into the current folder
            mujoco.set_mju_user_warning(lambda text: LOG.warning("MuJoCo warns: %s", one_line(text)))
        errors = SensorErrors.drawn(scenario, len(names))
        self.model = build_model(scenario, grasps, errors)
        self.data = mujoco.MjData(self.model)
        self._grasps = Grasps(names, grasps, self.model)
        arms = TorqueArms if scenario.robots.arms == "seven-joint" else Arms
        self._arms = arms(scenario, grasps, self.model, self.data)
        # The arms take up the weight; then the run starts at rest.
        self._arms.settle(int(SETTLING_TIME * PHYSICS_RATE))
        self.data.qvel[:] = 0.0
        self.data.time = 0.0
        homes = [self.model.site(home_name(name)).id for name in names]
        self._home_rotations = self.data.site_xmat[homes].reshape(-1, 3, 3)
        self._home_positions = self.data.site_xpos[homes].copy()
        self._is_holding = np.ones(len(names), dtype=np.bool_)
        # Readings (w, v, a) of the sensors of an arm that rests at its home, per robot.
        self._at_rest = np.zeros((len(names), READINGS))
        self._at_rest[:, ACCELERATION] = -self.model.opt.gravity @ self._home_rotations
        self._sensors, self._compliances = Sensors(scenario, errors), errors.compliances
        self._encoders = _encoders_of(scenario)
        self.loads = Loads(self.model, self.data, self.model.body(PAYLOAD).id, scenario.payload)
        self._loads_since = 0.0
        self._changes = by_border(scenario.load_changes, scenario.block_duration)
        self._slips = by_border(scenario.slips, scenario.block_duration)
        self._clocks: dict[str, float] = {}

    @property
    def _now(self) -> float:
        """Start of the next block [s]."""
        return self.block * self._scenario.block_duration

    @property
    def holders(self) -> list[str]:
        """Robots that hold the payload."""
        return [name for name, is_holding in zip(self._names, self._is_holding, strict=True) if is_holding]

    def holds(self, robot: str) -> bool:
        """Whether a robot holds the payload; raise ``SimulationError`` if there is no such robot."""
        return bool(self._is_holding[self._number(robot)])

    def inject(self, mass: float, position: Vector, size: Vector = (0.1, 0.1, 0.1), leak: float = 0.0) -> LoadState:
        """Add a load to the payload before the next block, or raise a ``LoadError``, see ``Loads.put``."""
        holding = list(compress(self._grasps.poses, self._is_holding))
        load = self.loads.put(mass, position, size, leak, Strength.of(holding, self._scenario.robots))
        self._loads_since = self._now
        return load

    def remove(self, load_id: int) -> LoadState:
        """Remove a load before the next block; raise ``LoadError`` if there is none with this number."""
        load = self.loads.take(load_id)
        self._loads_since = self._now
        return load

    def release(self, robot: str) -> None:
        """Let a robot release the payload before the next block; raise ``SimulationError`` if there is no such robot.

        From then on it exerts no wrench, and its sensors read an arm at rest at its home.
        """
        self._set_holding(robot, False)

    def grasp(self, robot: str) -> None:
        """Let a robot grasp the payload again, at its own grasp; errors as of ``release``."""
        self._set_holding(robot, True)

    def set_clock(self, robot: str, ahead: float) -> None:
        """Set before the next block how far a robot's clock is ahead [s], see ``ClockRequest``.

        Raises:
            SimulationError: There is no such robot, or ``ahead`` is not from 0 to 1 s.
        """
        if not 0.0 <= ahead <= LATEST:
            raise SimulationError(f"a clock may be 0 to {LATEST:g} s ahead, not {ahead:g} s")
        self._sensors.set_clock(self._number(robot), ahead)
        self._clocks = {name: each for name, each in {**self._clocks, robot: ahead}.items() if each}

    def _number(self, robot: str) -> int:
        if robot not in self._names:
            raise SimulationError(f"there is no robot {robot}: the robots are {', '.join(self._names)}")
        return self._names.index(robot)

    def _set_holding(self, robot: str, holding: bool) -> None:
        number = self._number(robot)
        self._arms.set_holding(robot, holding)
        if self._is_holding[number] != holding:
            self._sensors.begin_anew(number)
        self._is_holding[number] = holding

    def advance(self, references: Mapping[str, Reference]) -> BlockResult:
        """Simulate one block.

        Sample b of block k is the state at ``(k B + b) / rate`` seconds, because the engine's sensors read the state
        before a step. The payload is constant during a block; leaks take effect at its end.

        Args:
            references: Motion and wrench of the robots' arms during the block, by robot. A robot without a reference
                holds its last displacement.

        Raises:
            SimulationError: A reference is unusable, or the robots have lost the payload: the simulation is over.
        """
        problems = self._change_loads()
        self._let_grasps_slip()
        controls = self._arms.controls(references)
        check_controls(controls, self._arms.pushed, self._names, self._now)
        readings = step(self.model, self.data, self._arms, controls, self._scenario.sensors.block)
        ends = (self.block + 1) * self._scenario.block_duration
        check_held(readings.positions[-1], (readings.kinematics, readings.forces), ends)
        rotations = readings.rotations[:, None] @ self._grasps.rotations
        wrenches = self._arms.wrenches(readings.forces, rotations, self._home_rotations)
        kinematics = readings.kinematics
        if not self._is_holding.all():
            kinematics = np.where(self._is_holding[:, None], kinematics, self._at_rest)
        samples = self._sensors.measure(kinematics, wrenches)
        measurements = {
            name: Measurements(robot=name, block=self.block, samples=rows, holding=bool(is_holding))
            for name, rows, is_holding in zip(self._names, samples, self._is_holding, strict=True)
        }
        truth = self._truth(readings.positions[-1], samples[:, -1])
        self.loads.leak(self._scenario.block_duration)
        self.block += 1
        return BlockResult(measurements, truth, problems, self._measure_wrists(readings.positions, rotations, wrenches))

    def _measure_wrists(self, payload: Array, rotations: Array, wrenches: Array) -> Array | None:
        if self._encoders is None:
            return None
        from_body = np.array([-pose.inverse().translation for pose in self._grasps.poses])
        from_body = from_body + self._compliances[:, None] * wrenches[..., :3]
        positions = payload[:, None, :3] + np.einsum("bnij,bnj->bni", rotations, from_body)
        from_home = self._home_rotations.swapaxes(-1, -2) @ rotations
        return self._encoders.measure(
            positions=np.einsum("nji,bnj->bni", self._home_rotations, positions - self._home_positions),
            rotations=from_home,
            forces=np.einsum("bnij,bnj->bni", from_home, wrenches[..., :3]),
        )

    def _change_loads(self) -> tuple[str, ...]:
        """Make the scenario's load changes that are due; return descriptions of those that had to be skipped."""
        problems = []
        for change in self._changes.get(self.block, ()):
            try:
                if change.remove is not None:
                    self.remove(change.remove)
                elif change.mass is not None:
                    self.inject(change.mass, change.position, change.size, change.leak)
            except LoadError as error:
                problems.append(f"the load change at {change.at} s was skipped: {error}")
        return tuple(problems)

    def _let_grasps_slip(self) -> None:
        for slip in self._slips.get(self.block, ()):
            number = self._names.index(slip.robot)
            self._grasps.slip(slip.robot, slip.pose())
            self._arms.move_grasp(slip.robot, self._grasps.poses[number])
            self._sensors.begin_anew(number)

    def _truth(self, position: Array, samples: Array) -> Truth:
        """Return the truth at the block's last sample, from the payload's position (7,) and measurements (N, 15)."""
        payload = self.loads.inertia
        holding = self._is_holding
        return Truth(
            block=self.block,
            time=(self.block + 1) * self._scenario.block_duration,
            payload=PayloadTruth(payload.mass, payload.com, payload.tensor),
            loads=self.loads.states,
            loads_since=self._loads_since,
            position=position[:3],
            quaternion=position[3:],
            total_wrench=np.einsum("nij,nj->i", self._grasps.adjoints[holding], samples[holding, WRENCH]),
            samples=samples,
            slipped=self._grasps.slipped,
            clocks=self._clocks,
        )


def _encoders_of(scenario: Scenario) -> Encoders | None:
    errors = scenario.sensors.encoders
    if errors is None:
        return None
    from coheft.physics_server.arms.encoders import Encoders  # slow to import: it loads scipy

    return Encoders(errors, scenario)
