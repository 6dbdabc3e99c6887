"""The robots' grasps on the payload, which change when one slips."""

from collections.abc import Sequence

import mujoco
import numpy as np

from coheft.estimation.geometry.spatial import Pose, quaternion_from_rotation, rotation_from_quaternion
from coheft.wire.messages.truth import SlippedGrasp


class Grasps:
    """The grasp frames of N robots in the payload's frame.

    Args:
        model: The engine's model. Sites of a robot on the payload (grasp and sensors) have names that begin with its
            own.

    Attributes:
        poses: The present poses.
        rotations: Their rotations, shape (N, 3, 3).
        adjoints: Their adjoints, shape (N, 6, 6).
        slipped: Present grasps of robots whose grasp has slipped.
    """

    def __init__(self, robots: Sequence[str], poses: Sequence[Pose], model: mujoco.MjModel) -> None:
        self._robots, self._model = tuple(robots), model
        self.poses = list(poses)
        self.rotations = np.array([pose.rotation for pose in poses])
        self.adjoints = np.array([pose.adjoint() for pose in poses])
        self.slipped: dict[str, SlippedGrasp] = {}

    def slip(self, robot: str, slip: Pose) -> None:
        """Move a robot's grasp; ``slip`` is the pose of the new grasp frame in the previous one."""
        number, model = self._robots.index(robot), self._model
        before = self.poses[number]
        after = before @ slip
        on_payload, names = model.site(robot).bodyid, [robot, f"{robot}_at_velocity", f"{robot}_at_acceleration"]
        for site in range(model.nsite):
            if model.site(site).name in names and model.site_bodyid[site] == on_payload:
                own = Pose(rotation_from_quaternion(model.site_quat[site]), model.site_pos[site].copy())
                moved = after @ before.inverse() @ own
                model.site_pos[site] = moved.translation
                model.site_quat[site] = quaternion_from_rotation(moved.rotation)
                model.site_sameframe[site] = 0  # its frame is no longer that of the body or of its inertia
        self.poses[number], self.rotations[number] = after, after.rotation
        self.adjoints[number] = after.adjoint()
        self.slipped = self.slipped | {robot: SlippedGrasp(after.rotation, after.translation)}
