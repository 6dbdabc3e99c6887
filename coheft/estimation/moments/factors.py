"""Information matrices as products of two factors, so that parts of them can be computed without the rest.

information = left right^T,    and between own unknowns of robot i also own_left_i own_right_i^T
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np

from coheft.estimation.geometry.spatial import Array


class Factor(NamedTuple):
    """A factor for m unknowns: k own ones of each robot, those of one robot after another, then common ones.

    Attributes:
        team: Parts for all unknowns, shapes (m, f).
        own: Parts for robots' own unknowns that only meet those of the same robot, shapes (N, k, f).
    """

    team: tuple[Array, ...]
    own: tuple[Array, ...]

    @staticmethod
    def of(team: Iterable[Array], own: Iterable[Array]) -> Factor:
        """Of parts of which the last two axes become one, ``f``."""
        return Factor(*(tuple(part.reshape(*part.shape[:-2], -1) for part in parts) for parts in (team, own)))

    def times(self, right: Factor) -> Array:
        """Compute the information between these m unknowns and m' others, shape (m, m')."""
        result = _sum_of_products(self.team, right.team)
        blocks = _sum_of_products(self.own, right.own)
        count, own, others = blocks.shape
        of_robots = result[: count * own, : count * others].reshape(count, own, count, others)
        of_robots[range(count), :, range(count)] += blocks
        return result

    def groups_times(self, right: Factor, size: int) -> Array:
        """Compute the information of each group of so many own unknowns, shape (N k / size, size, size).

        Both factors have no common unknowns.
        """
        left, other = (
            [part.reshape(-1, size, part.shape[-1]) for part in (*each.team, *each.own)] for each in (self, right)
        )
        return _sum_of_products(left, other)


def _sum_of_products(left: Iterable[Array], right: Iterable[Array]) -> Array:
    products = [one @ np.swapaxes(other, -1, -2) for one, other in zip(left, right, strict=True)]
    result = products[0]
    for product in products[1:]:
        result += product
    return result
