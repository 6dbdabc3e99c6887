"""Seven-joint arms whose joint torques realize a spring and damper at the hand.

Operational-space impedance (Hogan 1985; Khatib 1987): the joints exert ``J^T w`` for the wrench ``w`` of a spring
between hand and home frame, plus the feed-forward wrench, plus the arm's own gravity and Coriolis torques. The
remaining degree of freedom of the seven joints is held near the home angles.
"""

from collections.abc import Sequence

import mujoco
import numpy as np

from coheft.errors import SimulationError
from coheft.estimation.geometry.spatial import Array, Pose, rotation_log
from coheft.physics_server.arms.impedance import Arms
from coheft.physics_server.arms.model import HOME_ANGLES, JOINTS, hand_name, joint_addresses
from coheft.physics_server.scene import home_name
from coheft.wire.scenario.schema import Scenario

_POSTURE_STIFFNESS = 10.0
"""Stiffness in the null space of the hand's Jacobian [N·m/rad]."""
_POSTURE_DAMPING = 4.0
"""Damping in the null space of the hand's Jacobian [N·m·s/rad]."""


class TorqueArms(Arms):
    """Arms that are welded to the payload; otherwise as ``Arms``.

    The controller uses the arms' state of the last stage of the integrator's step.
    """

    def __init__(self, scenario: Scenario, grasps: Sequence[Pose], model: mujoco.MjModel, data: mujoco.MjData) -> None:
        super().__init__(scenario, grasps, model, data)
        robots = scenario.robot_names
        (k_t, k_r), (d_t, d_r) = scenario.robots.stiffness, scenario.robots.damping
        self._stiffness = np.repeat([k_t, k_r], 3)
        self._damping = np.repeat([d_t, d_r], 3)
        self._hands = np.array([model.site(hand_name(name)).id for name in robots])
        self._homes = np.array([model.site(home_name(name)).id for name in robots])
        addresses = [joint_addresses(model, name) for name in robots]
        self._positions = np.array([positions for positions, _ in addresses])
        self._velocities = np.array([velocities for _, velocities in addresses])
        self._jacobian = np.zeros((len(robots), 6, model.nv))

    def settle(self, steps: int) -> None:
        """Simulate some steps in which the arms take up the weight."""
        data = self._data
        data.qpos[self._positions] = HOME_ANGLES
        mujoco.mj_forward(self._model, data)
        at_home = np.zeros(6 * len(self._hands))
        for _ in range(steps):
            self.drive(at_home)
            mujoco.mj_step(self._model, data)

    def drive(self, control: Array) -> None:
        """Set the joints' torques for the next step; ``control`` is a row of ``controls``."""
        data, count = self._data, len(self._hands)
        wanted = control.reshape(count, 6)
        for jacobian, hand in zip(self._jacobian, self._hands, strict=True):
            mujoco.mj_jacSite(self._model, data, jacobian[:3], jacobian[3:], hand)
        jacobians = np.take_along_axis(self._jacobian, self._velocities[:, None], axis=2)
        homes = data.site_xmat[self._homes].reshape(count, 3, 3)
        hands = data.site_xmat[self._hands].reshape(count, 3, 3)
        offset = np.einsum("nji,nj->ni", homes, data.site_xpos[self._hands] - data.site_xpos[self._homes])
        turn = np.array([rotation_log(rotation) for rotation in homes.swapaxes(-1, -2) @ hands])
        joint_rates = data.qvel[self._velocities]
        velocity = np.einsum("nij,nj->ni", jacobians, joint_rates)
        velocity_at_home = np.einsum("nji,nkj->nki", homes, velocity.reshape(count, 2, 3)).reshape(count, 6)
        spring = self._stiffness * (wanted - np.hstack([offset, turn])) - self._damping * velocity_at_home
        in_world = np.einsum("nij,nkj->nki", homes, spring.reshape(count, 2, 3))
        in_world += np.einsum("nij,nkj->nki", hands, self.pushed.reshape(count, 2, 3))
        posture = _POSTURE_STIFFNESS * (HOME_ANGLES - data.qpos[self._positions]) - _POSTURE_DAMPING * joint_rates
        # Projection onto the null space: subtract the wrench of the posture torques at the hand.
        posture_wrench = np.linalg.solve(
            jacobians @ jacobians.swapaxes(-1, -2), np.einsum("nij,nj->ni", jacobians, posture)[..., None]
        )
        wrench = in_world.reshape(count, 6) - posture_wrench[..., 0]
        torques = np.einsum("nij,ni->nj", jacobians, wrench) + posture + data.qfrc_bias[self._velocities]
        data.ctrl[:] = torques.reshape(count * JOINTS)

    def readings(self) -> Array:
        """Return a view of the wrists' force-torque readings, shape (6 N,): they are the last sensors."""
        readings: Array = self._data.sensordata[-6 * len(self._hands) :]
        return readings

    def set_holding(self, robot: str, holding: bool) -> None:
        """Raise ``SimulationError``, as welds cannot be released."""
        verb = "grasp" if holding else "release"
        raise SimulationError(f"the hand of {robot} is welded to the payload, it cannot {verb} it")

    def wrenches(self, read: Array, rotations: Array, home_rotations: Array) -> Array:
        """Return the wrenches on the payload, shape (B, N, 6): the readings at massless hands."""
        return read.reshape(*rotations.shape[:2], 6)
