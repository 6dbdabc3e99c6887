"""Which quantities of a cart the motion has shown so far, and which motion would show the others."""

import numpy as np

from coheft.estimation.geometry.spatial import Array

_QUANTITIES = {
    "mass": ("kg", 0.3, "mass is not known: speed up or slow down"),
    "d_x": ("m", 0.005, "centre of mass along the cart is not known: drive a curve"),
    "d_y": ("m", 0.005, "centre of mass across the cart is not known: speed up or slow down"),
    "inertia": ("kg·m²", 0.5, "moment of inertia is not known: drive into and out of curves"),
    "friction": ("N·s/m", 0.5, "friction is not known: drive at an even speed"),
    "turning friction": ("N·m·s", 0.5, "friction of turning is not known: drive on in a curve"),
}
"""Unit, standard deviation from which on it counts as not known, and what would show it."""
QUANTITIES = tuple(_QUANTITIES)
"""Names of the quantities of ``CartLearner.body_covariance``."""
UNITS = tuple(unit for unit, _, _ in _QUANTITIES.values())
_NOT_JUDGED = "too little has been measured to see whether it fits: drive on"


def not_known(body_covariance: Array, *, is_judged: bool = True) -> dict[str, str]:
    """Return the quantities that are not known yet, with the motion that would show them.

    They follow from the covariance of ``(m, d_x, d_y, I, sigma)``, shape (6, 6). Nothing is known before the
    measurements have been judged, that is compared with the model's predictions.
    """
    if not is_judged:
        return dict.fromkeys(QUANTITIES, _NOT_JUDGED)
    deviations = np.sqrt(np.diag(body_covariance))
    return {
        name: advice
        for (name, (_, limit, advice)), deviation in zip(_QUANTITIES.items(), deviations, strict=True)
        if not deviation < limit
    }
