"""Checks that an estimate can be used: shapes are right, numbers are finite, and rotations are valid."""

import numpy as np

from coheft.errors import MessageError
from coheft.estimation.geometry.spatial import Array
from coheft.wire.messages.codec import check_number, check_numbers
from coheft.wire.messages.structs import PayloadEstimate, PoseEstimate

ROTATION_TOLERANCE = 1e-6
"""Largest deviation of a valid rotation matrix from orthonormality."""


def check_payload(payload: PayloadEstimate) -> None:
    """Check a robot's estimate of the payload; raise ``MessageError`` if it cannot be used."""
    check_number(payload.mass, "mass")
    size = 1
    if payload.com is not None:
        check_numbers(payload.com, (3,), "com")
        size = 4
    if payload.tensor is not None:
        if payload.com is None:
            raise MessageError("com is missing but expected, because there is a tensor")
        check_numbers(payload.tensor, (3, 3), "tensor")
        size = 10
    _check_covariance(payload.covariance, size, "payload")


def check_pose(pose: PoseEstimate, name: str) -> None:
    """Check an estimate of the pose of the neighbour ``name``; raise ``MessageError`` if it cannot be used."""
    check_numbers(pose.translation, (3,), f"translation of {name!r}")
    _check_covariance(pose.covariance, 6, f"pose of {name!r}")
    check_rotation(pose.rotation, name)


def check_rotation(rotation: Array, name: str) -> None:
    """Check the rotation (3, 3) of the neighbour ``name``; raise ``MessageError`` if it is none."""
    check_numbers(rotation, (3, 3), f"rotation of {name!r}")
    difference = np.abs(rotation.T @ rotation - np.eye(3)).max()
    if difference > ROTATION_TOLERANCE or np.linalg.det(rotation) < 0.0:
        raise MessageError(f"rotation of {name!r} is not valid: expected an orthonormal matrix with determinant 1")


def _check_covariance(covariance: Array, size: int, name: str) -> None:
    check_numbers(covariance, (size, size), f"covariance of {name}")
    if (np.diagonal(covariance) < 0.0).any():
        raise MessageError(f"covariance of {name} has a negative variance")
