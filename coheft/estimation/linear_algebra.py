"""Linear algebra in double precision, with exact types."""

import numpy as np

from coheft.estimation.geometry.spatial import Array


def inverse(matrix: Array) -> Array:
    """Return the inverses of matrices (..., k, k).

    Raises:
        numpy.linalg.LinAlgError: A matrix is singular.
    """
    return np.asarray(np.linalg.inv(matrix), dtype=np.float64)


def positive_part(symmetric: Array) -> Array:
    """A symmetric matrix (k, k) without what belongs to its negative eigenvalues."""
    values, vectors = np.linalg.eigh(symmetric)
    result: Array = (vectors * np.maximum(values, 0.0)) @ vectors.T
    return result


def is_positive_definite(matrix: Array) -> bool:
    """Whether a symmetric matrix (k, k) has positive eigenvalues only."""
    try:
        np.linalg.cholesky(matrix)
    except np.linalg.LinAlgError:
        return False
    return True


def principal_axes(symmetric: Array) -> tuple[Array, Array]:
    """Return the eigenvalues (3,) of a symmetric matrix (3, 3), ascending, and their axes as a rotation (3, 3)."""
    values, axes = np.linalg.eigh(symmetric)
    return values, axes * np.sign(np.linalg.det(axes))  # a rotation, not a reflection
