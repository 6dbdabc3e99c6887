"""How a grasp frame is carried, against the definition: poses, and their derivatives."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from coheft.estimation.geometry.carried_motion import carried_motion
from coheft.estimation.geometry.spatial import Array, Pose, rotation_exp, rotation_log
from tests.rigid_motions import axes, poses, vectors

STEP = 1e-5
turns = st.builds(lambda angle, axis: angle * axis, st.one_of(st.floats(0.0, 2.5), st.floats(0.0, 0.02)), axes)


@given(turns, vectors(1.0), vectors(1.0, 6), poses)
def test_a_grasp_is_carried_as_a_rigid_body_would(turn: Array, shift: Array, rate: Array, pose: Pose) -> None:
    displacement = np.concatenate([turn, shift])
    motion = carried_motion(displacement[None], rate[None], pose)
    expected = pose.inverse() @ Pose(rotation_exp(turn), shift) @ pose
    np.testing.assert_allclose(rotation_exp(motion.rotation[0]), expected.rotation, atol=1e-9)
    np.testing.assert_allclose(motion.position[0], expected.translation, atol=1e-9)


@given(turns, vectors(1.0), vectors(1.0, 6), poses)
def test_rates_are_the_derivatives(turn: Array, shift: Array, rate: Array, pose: Pose) -> None:
    displacement = np.concatenate([turn, shift]) + STEP * np.array([-1.0, 0.0, 1.0])[:, None] * rate
    motion = carried_motion(displacement, np.tile(rate, (3, 1)), pose)

    def derivative(values: Array) -> Array:
        return (values[2] - values[0]) / (2.0 * STEP)

    np.testing.assert_allclose(motion.rotation_rate[1], derivative(motion.rotation), atol=1e-7)
    np.testing.assert_allclose(motion.velocity[1], derivative(motion.position), atol=1e-7)
    before, after = rotation_exp(motion.rotation[0]), rotation_exp(motion.rotation[2])
    np.testing.assert_allclose(motion.w[1], rotation_log(after @ before.T) / (2.0 * STEP), atol=1e-7)
