"""Rows that are told apart by their numbers."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from coheft.estimation.geometry.spatial import Array
from coheft.estimation.moments.moments import RowMoments
from coheft.estimation.moments.row_buffer import RowBuffer

SIZE = 5


def row(number: int) -> Array:
    return np.append(np.random.default_rng(number + 1000).normal(size=SIZE - 1), 1.0)


def gram(rows: Sequence[Array]) -> Array:
    return np.sum([np.outer(each, each) for each in rows], axis=0) if rows else np.zeros((SIZE, SIZE))


def assert_moments(buffer: RowBuffer, everything: Array, load: Array) -> None:
    found, of_load = buffer.moments()
    assert isinstance(found, RowMoments)
    assert isinstance(of_load, RowMoments)
    np.testing.assert_allclose(found.matrix, everything, atol=1e-9 * max(1.0, np.abs(everything).max()))
    np.testing.assert_allclose(of_load.matrix, load, atol=1e-9 * max(1.0, np.abs(load).max()))
