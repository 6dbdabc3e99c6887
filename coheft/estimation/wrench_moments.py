"""What a team's wrenches say about its load, summed so that better poses still improve it afterwards.

Estimating inertia takes moments of the **total** wrench with the body's motion. The total is a sum over robots, carried
with their poses, and so are its moments:

    sum over samples of  x (sum_i Ad(g_i) u_i)^T  =  sum_i (sum over samples of  x u_i^T) Ad(g_i)^T.

So every robot keeps the moments of its own wrench ``u_i`` with the motion's features ``x``, and the network sums the
small matrices on the right, carried with the newest poses. Nothing of the early, worse poses stays in the result.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from coheft.estimation.body_motion import BODY_W, MOTION_SIZE
from coheft.estimation.inertia import symmetric_products
from coheft.estimation.registration import MOTION, PRODUCTS
from coheft.estimation.spatial import Array, Pose

FEATURES = 19
"""1, the body motion ``(w, v, a, alpha)``, six products of ``w``."""
_OF_REGISTRATION = np.r_[0, MOTION.start : PRODUCTS.stop]


@dataclass(frozen=True, eq=False)
class WrenchMoments:
    """Sums over samples of features times wrench. Add up those of several blocks, or carried ones of several robots.

    Attributes:
        cross: Shape (19, 6).
    """

    cross: Array

    @staticmethod
    def none() -> WrenchMoments:
        """Of no samples."""
        return WrenchMoments(np.zeros((FEATURES, 6)))

    @staticmethod
    def of(wrenches: Array, motion: Array) -> WrenchMoments:
        """Of simultaneous wrenches ``(f, t)`` in any one frame, shape (n, 6), and body motions, shape (n, 12).

        Raises:
            ValueError: Shapes do not fit.
        """
        if wrenches.shape[1:] != (6,) or motion.shape != (len(wrenches), MOTION_SIZE):
            raise ValueError(f"{wrenches.shape=} and {motion.shape=} but expected (n, 6) and (n, 12)")
        features = np.hstack([np.ones((len(motion), 1)), motion, symmetric_products(motion[:, BODY_W])])
        return WrenchMoments(features.T @ wrenches)

    def __add__(self, other: WrenchMoments) -> WrenchMoments:
        return WrenchMoments(self.cross + other.cross)

    def carried(self, pose_j_in_i: Pose) -> WrenchMoments:
        """The same with the wrenches carried from ``F_j`` to ``F_i``; the motion's features stay as they are."""
        return WrenchMoments(self.cross @ pose_j_in_i.adjoint().T)

    def mapped(self, feature_map: Array) -> WrenchMoments:
        """As if the motions had been found with other poses: ``feature_map`` (28, 28) of ``refit_map``."""
        return WrenchMoments(feature_map[np.ix_(_OF_REGISTRATION, _OF_REGISTRATION)] @ self.cross)
