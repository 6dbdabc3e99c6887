"""Evidence on some unknowns beside those of a fit: their score, and their information with all unknowns of the fit.

    S_k,    I_ko = sum D_k^T W D_o

``o`` are all unknowns of the fit, ``k`` errors of sensors that it does not have (``undeclared``), or poses, which it
has as well (``pose_steps``). This takes less time than the evidence on all of them.
"""

from __future__ import annotations

from coheft.estimation.geometry.spatial import Array
from coheft.estimation.moments.derivatives import MotionDerivatives, WrenchDerivatives
from coheft.estimation.moments.likelihood import (
    Derivatives,
    Factor,
    Grams,
    MotionFactors,
    between_robots,
    motion_grams,
    motion_score,
    noise_factors,
    noise_grams,
    without_noise,
    wrench_factors,
    wrench_score,
)
from coheft.estimation.moments.moments import EvaluatedMoments


class BesideFit:
    """Some unknowns of each robot, in groups of g that belong together.

    Args:
        of_fit: Derivatives by the unknowns of the fit.
        motion: Derivatives of motion sensors by these k unknowns.
        wrench: Derivatives of the total wrench by them.
        group: Size of a group, ``g``.
    """

    def __init__(self, of_fit: Derivatives, motion: MotionDerivatives, wrench: WrenchDerivatives, group: int) -> None:
        self._body, self._of_fit, self._group = of_fit.body, of_fit, group
        self._motion, self._wrench = MotionFactors.of(of_fit.body, motion), wrench

    def evidence(self, moments: EvaluatedMoments) -> tuple[Array, Array, Array]:
        """Score of rows, shape (k,); their information with the unknowns of the fit, shape (k, u), and that of each
        group alone, shape (k / g, g, g).
        """
        body, wrench = self._body, without_noise(self._body, moments.wrench)
        score = motion_score(body, self._motion.derivatives, moments.motion) + wrench_score(self._wrench, wrench)
        left, right = wrench_factors(body, self._wrench, wrench)
        both, alone = left.times(wrench_factors(body, self._of_fit.wrench, wrench)[1]), self._alone(left, right)
        own = slice(0, body.count * body.unknowns.own)
        both[:, own] += between_robots(self._wrench, self._of_fit.wrench, wrench)
        return score, *self._with_motion(both, alone, motion_grams(body, moments.motion))

    def noise(self, motion_rows: float, wrench_rows: float) -> tuple[Array, Array]:
        """What the regressors' noise in so many rows adds to the information."""
        left, right = noise_factors(self._body, self._wrench, wrench_rows)
        of_fit = noise_factors(self._body, self._of_fit.wrench, wrench_rows)[1]
        return self._with_motion(left.times(of_fit), self._alone(left, right), noise_grams(self._body, motion_rows))

    def noise_alone(self, motion_rows: float, wrench_rows: float) -> Array:
        """What that noise adds to the information of each group alone, shape (k / g, g, g)."""
        by_wrench = self._alone(*noise_factors(self._body, self._wrench, wrench_rows))
        left = self._motion.left(noise_grams(self._body, motion_rows))
        return by_wrench + self._alone(left, self._motion.right)

    def _alone(self, left: Factor, right: Factor) -> Array:
        return left.groups_times(right, self._group)

    def _with_motion(self, both: Array, alone: Array, grams: Grams) -> tuple[Array, Array]:
        """Add what motion sensors contribute."""
        left = self._motion.left(grams)
        both[:, : self._body.unknowns.motion_size] += left.times(self._of_fit.motion.right)
        alone += self._alone(left, self._motion.right)
        return both, alone
