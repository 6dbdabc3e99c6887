"""What poses that are off add to the total wrench."""

from __future__ import annotations

import numpy as np
import pytest

from coheft.estimation.body_motion import perturbed
from coheft.estimation.pose_disturbance import wrench_disturbance
from coheft.estimation.spatial import Array, Pose, rotation_exp, skew

COUNT = 4


def some_poses(rng: np.random.Generator) -> list[Pose]:
    return [Pose(rotation_exp(rng.normal(size=3)), 0.5 * rng.normal(size=3)) for _ in range(COUNT)]


def as_one_body(poses: list[Pose]) -> Array:
    """Perturbations (6 N, 6) of all poses when the body frame is perturbed."""
    return np.vstack([np.block([[np.eye(3), np.zeros((3, 3))], [-skew(p.translation), np.eye(3)]]) for p in poses])


@pytest.mark.parametrize("seed", range(4))
def test_it_is_the_scatter_of_total_wrenches(seed: int) -> None:
    rng = np.random.default_rng(seed)
    poses, rms = some_poses(rng), rng.uniform(5.0, 40.0, COUNT)
    root = 1e-4 * rng.normal(size=(6 * COUNT, 6 * COUNT))
    common = as_one_body(poses)
    root -= common @ np.linalg.lstsq(common, root, rcond=None)[0]
    added = np.zeros((4000, 6))
    for sample in added:
        errors = (root @ rng.normal(size=6 * COUNT)).reshape(COUNT, 6)
        for pose, error, size in zip(poses, errors, rms, strict=True):
            force = np.concatenate([size / np.sqrt(3.0) * rng.normal(size=3), np.zeros(3)])
            sample += (perturbed(pose, error).adjoint() - pose.adjoint()) @ force
    expected = wrench_disturbance(poses, root @ root.T, rms**2)
    scale = np.sqrt(np.outer(np.diag(expected), np.diag(expected)))
    np.testing.assert_allclose(np.cov(added.T) / scale, expected / scale, atol=0.15)


@pytest.mark.parametrize("seed", range(4))
def test_nothing_is_spoilt_if_all_poses_are_off_as_one_body(seed: int) -> None:
    poses = some_poses(np.random.default_rng(seed))
    common = as_one_body(poses)
    np.testing.assert_allclose(wrench_disturbance(poses, common @ common.T, np.full(COUNT, 100.0)), 0.0, atol=1e-9)
