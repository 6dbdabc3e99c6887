"""The robots' arms under impedance control: impedance about a moving reference, plus feed-forward.

The wrench on the payload is exactly the sum of two parts:

- *spring*: six engine actuators between the grasp frame ``F_i`` and the robot's home frame, in the axes of the home
  frame: ``f = k_t (x_ref - x) + d_t (dx_ref - dx)``, and likewise for the rotation vector and the torque;
- *push*: the feed-forward wrench, in the axes of ``F_i``. The sum over all robots is applied to the payload's joint,
  because actuators would cost the engine as much as those of a spring even when they are not used.
"""

from collections.abc import Mapping, Sequence

import mujoco
import numpy as np

from coheft.estimation.geometry.spatial import Array, Pose
from coheft.wire.messages.structs import Reference
from coheft.wire.scenario.schema import PHYSICS_RATE, Scenario

_ACTUATOR_ORDER = np.array([3, 4, 5, 0, 1, 2, 9, 10, 11, 6, 7, 8])
"""Column order of actuators (translation first, as in wrenches) in a reference's motion (rotation first)."""


def add_arm(
    spec: mujoco.MjSpec, site: str, home_site: str, stiffness: tuple[float, float], damping: tuple[float, float]
) -> None:
    """Add the six actuators of one robot's spring: force, then torque."""
    for axis, gear in enumerate(np.eye(6)):
        part = 0 if axis < 3 else 1
        spring = spec.add_actuator(
            name=f"{site}_spring{axis}", trntype=mujoco.mjtTrn.mjTRN_SITE, target=site, refsite=home_site, gear=gear
        )
        spring.set_to_position(kp=stiffness[part], kv=damping[part])


class Arms:
    """Turns the robots' references into actuator controls, and actuator forces into wrenches.

    A robot without a reference for a block holds its last displacement, at rest and without feed-forward.

    Args:
        model: The engine's model with their actuators; the payload's free joint comes first.

    Attributes:
        pushed: Feed-forward wrench ``(f, t)`` of each robot in its own ``F_i`` during the newest block, shape (N, 6).
    """

    def __init__(self, scenario: Scenario, grasps: Sequence[Pose], model: mujoco.MjModel, data: mujoco.MjData) -> None:
        self._robots = scenario.robot_names
        self._adjoints = np.array([grasp.adjoint() for grasp in grasps])
        self._is_holding = np.ones(len(self._robots), dtype=np.bool_)
        self._model, self._data = model, data
        self._make_views()
        self.pushed = np.zeros((len(self._robots), 6))
        self._push_on_payload: Array | None = None
        self._gains = model.actuator_gainprm.copy(), model.actuator_biasprm.copy()
        count, samples = len(self._robots), scenario.sensors.block
        self._steps_per_sample = PHYSICS_RATE // scenario.sensors.rate
        (k_t, k_r), (d_t, d_r) = scenario.robots.stiffness, scenario.robots.damping
        damping = np.repeat([d_t / k_t, d_r / k_r if k_r > 0.0 else 0.0], 3)  # a gimbal has neither
        # Between samples the reference is extrapolated with its rate, and the rate with its slope: constant rates would
        # excite the payload at half the sample rate. The spring's damping also acts on the reference's rate.
        since_sample = np.arange(self._steps_per_sample)[:, None, None] / PHYSICS_RATE
        self._rate_gains = since_sample + damping
        self._slope_gains = scenario.sensors.rate * since_sample * (0.5 * since_sample + damping)
        self._motions = np.zeros((count, samples, 12))

    def _make_views(self) -> None:
        """Make views of the engine's arrays, once per block and object: the engine makes a new one at every access."""
        data = self._data
        self._control, self._force = data.ctrl, data.actuator_force
        self._applied, self._quaternion = data.qfrc_applied[:6], data.qpos[3:7]
        self._applied_force = self._applied[:3]

    def controls(self, references: Mapping[str, Reference]) -> Array:
        """Return the controls for ``drive`` at every physics step of a block; the push is the same for all of them.

        Returns:
            Displacements from the homes at which the springs are at rest, shape (B * steps per sample, 6 N).
        """
        self._make_views()
        self.pushed[:] = 0.0
        for i, robot in enumerate(self._robots):
            reference = references.get(robot)
            if reference is None:
                self._motions[i, :, :6] = self._motions[i, -1, :6]
                self._motions[i, :, 6:] = 0.0
                continue
            self._motions[i] = reference.motion
            if self._is_holding[i]:
                self.pushed[i] = reference.wrench
        self._push_on_payload = np.einsum("nij,nj->i", self._adjoints, self.pushed) if self.pushed.any() else None
        motions = self._motions.swapaxes(0, 1)[..., _ACTUATOR_ORDER]
        rate = motions[..., 6:]
        spring = motions[:, None, :, :6] + rate[:, None] * self._rate_gains
        if self._steps_per_sample > 1:
            slope = np.diff(rate, axis=0)
            # The next block's reference is not known yet, so the last slope is extrapolated.
            slope = np.concatenate([slope, 2.0 * slope[-1:] - slope[-2:-1] if len(slope) > 1 else slope])
            spring += slope[:, None] * self._slope_gains
        wanted: Array = spring.reshape(-1, 6 * len(self._robots))
        return wanted

    def settle(self, steps: int) -> None:
        """Simulate some steps in which the arms take up the weight."""
        mujoco.mj_step(self._model, self._data, nstep=steps)

    def drive(self, control: Array) -> None:
        """Set the actuators and the push for the next step; ``control`` is a row of ``controls``.

        The caller sets the forces applied to joints to zero before a block.
        """
        self._control[:] = control
        if self._push_on_payload is not None:
            # A free joint's velocity is in the axes of the world, its angular velocity in the axes of the body.
            self._applied[:] = self._push_on_payload
            mujoco.mju_rotVecQuat(self._applied_force, self._push_on_payload[:3], self._quaternion)

    def readings(self) -> Array:
        """Return a view, (6 N,), of the springs' forces at the state before the last step, for ``wrenches``."""
        forces: Array = self._force
        return forces

    def set_holding(self, robot: str, holding: bool) -> None:
        """Let an arm act on the payload, or not: actuators without gains exert no force."""
        number = self._robots.index(robot)
        self._is_holding[number] = holding
        actuators = slice(6 * number, 6 * number + 6)
        gains, biases = self._gains
        self._model.actuator_gainprm[actuators] = gains[actuators] if holding else 0.0
        self._model.actuator_biasprm[actuators] = biases[actuators] if holding else 0.0

    def move_grasp(self, robot: str, grasp: Pose) -> None:
        """Change a robot's grasp to a new pose in the payload's frame."""
        self._adjoints[self._robots.index(robot)] = grasp.adjoint()

    def wrenches(self, read: Array, rotations: Array, home_rotations: Array) -> Array:
        """Return the wrenches on the payload.

        Args:
            read: Readings at B samples, shape (B, 6 N) [N, N·m].
            rotations: Rotations of the grasp frames in the world, shape (B, N, 3, 3).
            home_rotations: Rotations of the home frames in the world, shape (N, 3, 3).

        Returns:
            Shape (B, N, 6): ``(f, t)`` of each robot in its own ``F_i``.
        """
        samples, count = rotations.shape[:2]
        springs = read.reshape(samples, count, 2, 3)
        home_in_grasp = rotations.swapaxes(-1, -2) @ home_rotations
        return (springs @ home_in_grasp.swapaxes(-1, -2)).reshape(samples, count, 6) + self.pushed
