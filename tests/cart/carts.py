"""Carts for tests, and how to draw them at random."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from hypothesis import strategies as st

from coheft.estimation.cart.model import CartBody
from coheft.estimation.geometry.spatial import Array

bodies = st.builds(
    CartBody,
    mass=st.floats(5.0, 60.0),
    com=st.tuples(st.floats(-0.5, 0.5), st.floats(-0.3, 0.3)),
    inertia=st.floats(0.5, 8.0),
    friction=st.tuples(st.floats(0.0, 20.0), st.floats(0.0, 20.0)),
)
angles = st.floats(-4.0, 4.0)


def vectors(size: int, largest: float) -> st.SearchStrategy[Array]:
    """Vectors with components up to a size."""
    return st.lists(st.floats(-largest, largest), min_size=size, max_size=size).map(np.array)


def differences(function: Callable[[Array], Array], at: Array, step: float = 1e-5) -> Array:
    """Derivative of a function at a point, by finite differences: a column for each component of the point."""
    return np.array([(function(at + by) - function(at - by)) / (2.0 * step) for by in step * np.eye(len(at))]).T
