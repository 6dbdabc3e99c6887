"""What the motion so far has shown of a cart, and what would show the rest."""

from __future__ import annotations

import numpy as np

from coheft.estimation.geometry.spatial import Array

QUANTITIES = ("mass", "d_x", "d_y", "inertia", "friction", "turning friction")
"""Of ``CartLearner.body_covariance``."""

_KNOWN = (0.3, 0.005, 0.005, 0.5, 0.5, 0.5)
"""Standard deviations above which a quantity counts as not known [kg, m, m, kg·m², N·s/m, N·m·s]."""
_SHOWN_BY = (
    "mass is not known: speed up or slow down",
    "centre of mass along the cart is not known: drive a curve",
    "centre of mass across the cart is not known: speed up or slow down",
    "moment of inertia is not known: drive into and out of curves",
    "friction is not known: drive at an even speed",
    "friction of turning is not known: drive on in a curve",
)


_NOT_JUDGED = "too little has been measured to see whether it fits: drive on"


def not_known(body_covariance: Array, *, is_judged: bool = True) -> dict[str, str]:
    """Quantities of which the motion has not shown enough, and what would show them, by name.

    Args:
        body_covariance: Of ``(m, d_x, d_y, I, sigma)``, shape (6, 6).
        is_judged: Whether measurements have been compared with what they should be.
    """
    if not is_judged:
        return dict.fromkeys(QUANTITIES, _NOT_JUDGED)
    deviations = np.sqrt(np.diag(body_covariance))
    return {
        name: advice
        for name, deviation, limit, advice in zip(QUANTITIES, deviations, _KNOWN, _SHOWN_BY, strict=True)
        if not deviation < limit
    }
