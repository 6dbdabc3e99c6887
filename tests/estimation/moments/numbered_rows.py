"""Rows that are told apart by their numbers, alone or with the rates that they should have."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from coheft.estimation.geometry.spatial import Array
from coheft.estimation.moments.moments import RowMoments
from coheft.estimation.moments.row_buffer import RowBuffer
from tests.estimation.moments.moving_team import PERIOD

SIZE = 5
WIDTH = 2 * SIZE - 1
"""With rates."""


def row(number: int) -> Array:
    return np.append(np.random.default_rng(number + 1000).normal(size=SIZE - 1), 1.0)


def gram(rows: Sequence[Array], width: int = SIZE) -> Array:
    return np.sum([np.outer(each, each) for each in rows], axis=0) if rows else np.zeros((width, width))


def assert_moments(buffer: RowBuffer, everything: Array, load: Array) -> None:
    found, of_load = buffer.moments()
    assert isinstance(found, RowMoments)
    assert isinstance(of_load, RowMoments)
    np.testing.assert_allclose(found.matrix, everything, atol=1e-9 * max(1.0, np.abs(everything).max()))
    np.testing.assert_allclose(of_load.matrix, load, atol=1e-9 * max(1.0, np.abs(load).max()))


def moving(numbers: Sequence[int]) -> RowBuffer:
    buffer = RowBuffer(SIZE, True, PERIOD)
    for number in numbers:
        buffer.add(number, buffer.extended(number, row(number)))
    return buffer


def extended(number: int, before: int | None = None, after: int | None = None) -> Array:
    """With the rate between two rows, the ones on both sides unless others are named."""
    first, last = number - 1 if before is None else before, number + 1 if after is None else after
    rate = (row(last) - row(first))[:-1] / ((last - first) * PERIOD)
    return np.concatenate([row(number), rate])


def central(*numbers: int) -> Array:
    return gram([extended(number) for number in numbers], WIDTH)
