"""Carts for tests, and how to draw them at random."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from hypothesis import strategies as st

from coheft.estimation.cart.model import UNICYCLE, CartBody, Constraints, Wheel
from coheft.estimation.geometry.spatial import Array

CONSTRAINTS = {
    "free": Constraints(()),
    "one axle": UNICYCLE,
    "an axle with two wheels": Constraints([Wheel((0.0, 0.3)), Wheel((0.0, -0.3))]),
    "an oblique wheel": Constraints([Wheel((0.2, 0.1), 0.4)]),
    "two axles": Constraints([Wheel(), Wheel((0.6, 0.0), 0.3)]),
}

bodies = st.builds(
    CartBody,
    mass=st.floats(5.0, 60.0),
    com=st.tuples(st.floats(-0.5, 0.5), st.floats(-0.3, 0.3)),
    inertia=st.floats(0.5, 8.0),
    friction=st.tuples(st.floats(0.0, 20.0), st.floats(0.0, 20.0)),
)
angles = st.floats(-4.0, 4.0)
constraints = st.sampled_from(sorted(CONSTRAINTS)).map(CONSTRAINTS.__getitem__)


def vectors(size: int, largest: float) -> st.SearchStrategy[Array]:
    """Vectors with components up to a size."""
    return st.lists(st.floats(-largest, largest), min_size=size, max_size=size).map(np.array)


def differences(function: Callable[[Array], Array], at: Array, step: float = 1e-5) -> Array:
    """Derivative of a function at a point, by finite differences: a column for each component of the point."""
    return np.array([(function(at + by) - function(at - by)) / (2.0 * step) for by in step * np.eye(len(at))]).T
