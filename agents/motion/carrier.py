"""One robot's part in carrying the load along a common path, with its estimate of the load.

The robot knows its own pose in the grasp frame of the first robot, hence how its own grasp has to move. It knows mass,
centre of mass and inertia in its own frame, hence the total wrench for that motion. It knows where every robot holds
the load, hence its own share. Its accelerometer gives the direction of gravity. No further messages are needed.
"""

from collections.abc import Mapping

import numpy as np

from coheft.agents.motion.common_path import CommonPath
from coheft.agents.motion.reference import ReferenceMotion
from coheft.estimation.geometry.carried_motion import CarriedMotion, carried_motion
from coheft.estimation.geometry.spatial import Array, Pose, rotation_exp
from coheft.estimation.measurement import ACCELERATION
from coheft.estimation.rigid_body.feedforward import load_shares, weight_deviations
from coheft.estimation.rigid_body.mass_properties import Inertia
from coheft.estimation.rigid_body.unobservable import middle_and_size
from coheft.wire.config import AgentConfig
from coheft.wire.messages.structs import Estimate, Validity
from coheft.wire.scenario.motion import Carry

_STEP = 1e-3
"""Time step of the finite differences that give accelerations [s]."""
_WELL_KNOWN = 0.03
"""An estimate is used if the standard deviations of the force and the torque that hold the load are below this share of
its weight, and of its weight times the size of the team."""
_CHANGE_TIME = 0.1
"""Time constant with which a new estimate replaces the one before [s]."""
_LEVEL_TIME = 1.0
"""Time over which the accelerometer is averaged [s]."""


class Carrier:
    """Computes references for one robot's arm.

    An estimate that is doubted, or not known well, is not used: the last good one stays in use. The poses of a former
    team also stay in use until there are new ones.
    """

    def __init__(self, config: AgentConfig, carry: Carry, alone: ReferenceMotion) -> None:
        self._config = config
        self._carry = carry
        self._alone = alone
        self._path: CommonPath | None = None
        self._pose_in_ref = Pose.identity()
        self._share = np.zeros((6, 6))
        self._size = 0.0
        # Proper acceleration of a frame at rest, in the axes of the home frame, and the number of blocks averaged.
        self._lift = np.zeros(3)
        self._lift_blocks = 0
        self._load: Inertia | None = None
        self._used = np.zeros(10)

    def learn(self, index: int, estimate: Estimate, grasps: Mapping[str, Pose]) -> None:
        """Use the robot's estimate after a block, and ``pose_j_in_ref`` of all robots that hold the load."""
        own = self._config.name
        if estimate.status is not Validity.VALID or own not in grasps:
            return
        self._pose_in_ref = grasps[own]
        poses = [self._pose_in_ref.inverse() @ pose for pose in grasps.values()]
        self._share = load_shares(poses)[list(grasps).index(own)]
        _, self._size = middle_and_size(poses)
        if self._path is None:
            start = max(self._carry.start, self._config.start_of(index + 1 + self._config.lag))
            self._path = CommonPath(self._carry, start)
        self._update_load(self._path, index, estimate)

    def _update_load(self, path: CommonPath, index: int, estimate: Estimate) -> None:
        """Use the estimated load, if it is known well enough at the attitude at which it would first be used."""
        payload = estimate.payload
        if payload is None or payload.com is None:
            return
        rotation, _, _, _ = self._mid_block_motion(path, index + self._config.lag)
        weight = payload.mass * float(np.linalg.norm(self._lift))
        force, torque = weight_deviations(payload.mass, payload.covariance, rotation.T @ self._lift)
        if weight == 0.0 or max(force, torque / self._size) > _WELL_KNOWN * weight:
            return
        before = np.zeros((3, 3)) if self._load is None else self._load.tensor
        self._load = Inertia(payload.mass, payload.com, before if payload.tensor is None else payload.tensor)

    def step(self, index: int, samples: Array | None) -> tuple[Array, Array]:
        """Return what the arm shall do ``lag`` blocks after this one: ``motion`` and ``wrench`` of a ``Reference``.

        ``samples`` are the robot's own of this block, shape (B, 15); None if they are unusable.
        """
        ahead = index + self._config.lag
        alone = self._alone.reference(ahead)
        if self._path is None:
            return alone, np.zeros(6)
        if samples is not None and self._config.start_of(index) >= self._path.full_from:
            self._update_gravity(index, samples)
        time = self._config.start_of(ahead) + np.arange(self._config.block) / self._config.rate
        common = self._motion(self._path, time)
        share, share_rate = self._path.share(time)
        fading = np.hstack(
            [(1.0 - share) * alone[:, :6], (1.0 - share) * alone[:, 6:] - share_rate * alone[:, :6]],
        )
        together = np.hstack([common.rotation, common.position, common.rotation_rate, common.velocity])
        return fading + together, self._wrench(self._path, ahead)

    def _update_gravity(self, index: int, samples: Array) -> None:
        """Update the mean of the accelerometer's reading minus the path's acceleration, the opposite of gravity."""
        assert self._path is not None
        rotation, acceleration, _, _ = self._mid_block_motion(self._path, index)
        read = rotation @ samples[:, ACCELERATION].mean(axis=0) - acceleration
        self._lift_blocks += 1
        self._lift += (read - self._lift) / min(self._lift_blocks, self._config.blocks(_LEVEL_TIME))

    def _wrench(self, path: CommonPath, block: int) -> Array:
        """Return this robot's share of the wrench that moves the load, mid-block: ``(f, t)`` in ``F_i``, (6,)."""
        carry = self._carry
        is_on = carry.feedforward and self._config.start_of(block) >= carry.feedforward_at
        is_level = self._lift_blocks >= self._config.blocks(_LEVEL_TIME)
        if not is_on or not is_level or self._load is None:
            return np.zeros(6)
        faster = self._config.blocks(_CHANGE_TIME)
        self._used += (self._load.barycentric() - self._used) / faster
        rotation, acceleration, w, alpha = self._mid_block_motion(path, block)
        load = Inertia.from_barycentric(self._used)
        total = load.wrench(rotation.T @ w, rotation.T @ (acceleration + self._lift), rotation.T @ alpha)
        wrench = self._share @ total
        force, torque = float(np.linalg.norm(wrench[:3])), float(np.linalg.norm(wrench[3:]))
        # Scaled down as a whole to what the arm can exert.
        limited: Array = wrench / max(1.0, force / carry.force_limit, torque / carry.torque_limit)
        return limited

    def _mid_block_motion(self, path: CommonPath, block: int) -> tuple[Array, Array, Array, Array]:
        """Return the motion of ``F_i`` in the middle of a block, in the axes of its home frame.

        Returns:
            Orientation (3, 3), acceleration of the origin, angular velocity and acceleration, each (3,).
        """
        middle = self._config.start_of(block) + 0.5 * (self._config.block - 1) / self._config.rate
        motion = self._motion(path, middle + _STEP * np.array([-1.0, 0.0, 1.0]))
        acceleration = (motion.velocity[2] - motion.velocity[0]) / (2.0 * _STEP)
        alpha = (motion.w[2] - motion.w[0]) / (2.0 * _STEP)
        return rotation_exp(motion.rotation[1]), acceleration, motion.w[1], alpha

    def _motion(self, path: CommonPath, time: Array) -> CarriedMotion:
        return carried_motion(*path.displacement(time), self._pose_in_ref)
