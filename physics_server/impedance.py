"""The robots' arms, as their firmware makes them behave: impedance about a moving reference, plus feed-forward.

Both parts are engine actuators on the grasp site, so the wrench on the payload is exactly their force:

- *spring*: six actuators between the grasp frame ``F_i`` and the robot's home frame, in the axes of the home frame:
  ``f = k_t (x_ref - x) + d_t (dx_ref - dx)`` and alike for the rotation vector and the torque;
- *motor*: six actuators that put the feed-forward wrench onto the payload, in the axes of ``F_i``.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import mujoco
import numpy as np

from coheft.estimation.spatial import Array
from coheft.wire.messages import Reference
from coheft.wire.scenario import PHYSICS_RATE, Scenario

_SPRING, _MOTOR = 0, 1


def add_arm(
    spec: mujoco.MjSpec, site: str, home_site: str, stiffness: tuple[float, float], damping: tuple[float, float]
) -> None:
    """Add one robot's twelve actuators: spring force and torque, then motor force and torque."""
    for axis, gear in enumerate(np.eye(6)):
        part = 0 if axis < 3 else 1
        spring = spec.add_actuator(
            name=f"{site}_spring{axis}", trntype=mujoco.mjtTrn.mjTRN_SITE, target=site, refsite=home_site, gear=gear
        )
        spring.set_to_position(kp=stiffness[part], kv=damping[part])
    for axis, gear in enumerate(np.eye(6)):
        motor = spec.add_actuator(name=f"{site}_motor{axis}", trntype=mujoco.mjtTrn.mjTRN_SITE, target=site, gear=gear)
        motor.set_to_motor()


class Arms:
    """Turns the robots' references into actuator controls, and actuator forces into wrenches.

    A robot that sends no reference for a block holds its last displacement at rest and pushes with no feed-forward.

    Attributes:
        controls_per_robot: Numbers that tell one robot what to do at a step.
        read_size: Numbers that say what all arms exert, see ``read``.
    """

    controls_per_robot: int = 12
    read_size: int

    def __init__(self, scenario: Scenario, robots: Sequence[str], model: mujoco.MjModel) -> None:
        self._robots = tuple(robots)
        self._model = model
        self.read_size = model.nu
        self._gains = model.actuator_gainprm.copy(), model.actuator_biasprm.copy()
        count, samples = len(self._robots), scenario.sensors.block
        self._steps_per_sample = PHYSICS_RATE // scenario.sensors.rate
        (k_t, k_r), (d_t, d_r) = scenario.robots.stiffness, scenario.robots.damping
        damping = np.repeat([d_t / k_t, d_r / k_r if k_r > 0.0 else 0.0], 3)  # a gimbal has neither
        # Until the next sample the reference goes on at its rate, and the rate at its slope: a rate that stood still
        # would shake the payload at half the sensors' rate. The spring's damping acts against the reference's rate too.
        since_sample = np.arange(self._steps_per_sample)[:, None, None] / PHYSICS_RATE
        self._rate_gains = since_sample + damping
        self._slope_gains = scenario.sensors.rate * since_sample * (0.5 * since_sample + damping)
        self._displacement = np.zeros((samples, count, 6))
        self._rate = np.zeros((samples, count, 6))
        self._controls = np.zeros((samples, self._steps_per_sample, count, 2, 6))

    def controls(self, references: Mapping[str, Reference]) -> Array:
        """What to ``drive`` the arms with at every physics step of a block.

        Args:
            references: By robot, see ``Reference``.

        Returns:
            Shape (B * steps per sample, 12 N), valid until the next call.
        """
        for i, robot in enumerate(self._robots):
            reference = references.get(robot)
            if reference is None:
                self._displacement[:, i] = self._displacement[-1, i]
                self._rate[:, i] = 0.0
                self._controls[..., i, _MOTOR, :] = 0.0
                continue
            # References name the rotation first, actuators (like wrenches) the translation.
            motion = reference.motion
            self._displacement[:, i, :3], self._displacement[:, i, 3:] = motion[:, 3:6], motion[:, :3]
            self._rate[:, i, :3], self._rate[:, i, 3:] = motion[:, 9:], motion[:, 6:9]
            self._controls[..., i, _MOTOR, :] = reference.wrench
        slope = np.diff(self._rate, axis=0)
        # The next block's reference is not known yet: the slope goes on as it has changed.
        slope = np.concatenate([slope, 2.0 * slope[-1:] - slope[-2:-1] if len(slope) > 1 else slope])
        spring = (
            self._displacement[:, None] + self._rate[:, None] * self._rate_gains + slope[:, None] * self._slope_gains
        )
        self._controls[..., _SPRING, :] = spring
        return self._controls.reshape(-1, self.controls_per_robot * len(self._robots))

    def settle(self, data: mujoco.MjData, steps: int) -> None:
        """Let the robots take up the weight."""
        mujoco.mj_step(self._model, data, nstep=steps)

    def drive(self, data: mujoco.MjData, control: Array) -> None:
        """Set the actuators for the next step; ``control`` is a row of ``controls``."""
        data.ctrl[:] = control

    def read(self, data: mujoco.MjData) -> Array:
        """What the arms exert at the state before the last step, for ``wrenches``: actuator forces, (12 N,)."""
        forces: Array = data.actuator_force
        return forces

    def set_holding(self, robot: str, holding: bool) -> None:
        """Let an arm act on the payload, or not: without gains its actuators exert nothing."""
        first = self.controls_per_robot * self._robots.index(robot)
        actuators = slice(first, first + self.controls_per_robot)
        gains, biases = self._gains
        self._model.actuator_gainprm[actuators] = gains[actuators] if holding else 0.0
        self._model.actuator_biasprm[actuators] = biases[actuators] if holding else 0.0

    def wrenches(self, read: Array, rotations: Array, home_rotations: Array) -> Array:
        """Wrenches on the payload that the actuators' forces are.

        Args:
            read: As read at B samples, shape (B, 12 N) [N, N·m].
            rotations: Of the grasp frames in the world, shape (B, N, 3, 3).
            home_rotations: Of the home frames in the world, shape (N, 3, 3).

        Returns:
            Shape (B, N, 6): ``(f, t)`` of each robot in its own ``F_i``.
        """
        samples, count = rotations.shape[:2]
        parts = read.reshape(samples, count, 2, 2, 3)
        home_in_grasp = rotations.swapaxes(-1, -2) @ home_rotations
        wrenches = parts[:, :, _SPRING] @ home_in_grasp.swapaxes(-1, -2) + parts[:, :, _MOTOR]
        return wrenches.reshape(samples, count, 6)
