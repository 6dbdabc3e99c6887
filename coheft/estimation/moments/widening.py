"""Wider tolerances where the found errors contradict the declared ones, kind by kind.

    s <- s sqrt(mean over robots and axes of (x^2 + P) / s^2),    from the declared tolerance to ``_MOST`` times it

``x`` are the found errors and ``P`` their posterior variances. One factor for all robots is what data sheets that are
too optimistic call for. Of offsets of forces, torques and gyros only the team's sums are found, and compared.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from coheft.estimation.geometry.spatial import Array
from coheft.estimation.moments.fit import Estimate
from coheft.estimation.moments.fit_settings import FitSettings
from coheft.estimation.moments.unknowns import OFFSET

_MOST = 4.0
"""Sensors that are worse than this times their tolerances are faulty; errors of any size would explain too much."""
_OFFSETS = ("force_offset", "torque_offset", "gyro_offset")
"""Kinds that are attributes of ``FitSettings``; all others are in ``FitSettings.errors``."""


def widened(estimate: Estimate, present: FitSettings, declared: FitSettings) -> FitSettings | None:
    """Return settings of fits with wider tolerances than the present ones, None if none may grow beyond those declared;
    the estimate is a fit of which the sensor errors are too large.
    """
    factors, is_wider = dict[str, float](), False
    for kind, squares in _squares(estimate, present).items():
        factor = _largest(present, kind) / _largest(declared, kind)
        wider = min(_MOST, factor * float(np.sqrt(squares.mean())))
        is_wider |= wider > factor
        factors[kind] = max(factor, wider)
    if not is_wider:
        return None
    offsets = {kind: getattr(declared, kind) * factors.pop(kind) for kind in _OFFSETS if kind in factors}
    return replace(present, errors=declared.errors.scaled(factors), **offsets)


def _largest(settings: FitSettings, kind: str) -> float:
    """Largest tolerance of a kind in the team; the others are in proportion."""
    if kind in _OFFSETS:
        return float(np.max(getattr(settings, kind)))
    return float(settings.errors.deviations[:, settings.errors.are(kind)].max())


def _squares(estimate: Estimate, settings: FitSettings) -> dict[str, Array]:
    """Return ``(x^2 + P) / s^2`` of each declared kind of error."""
    body, state = estimate.body, estimate.state
    unknowns, variances = body.unknowns, estimate.covariance.diagonal()
    of_eta, deviations = variances[unknowns.eta], unknowns.deviations
    is_found = (deviations > 0.0) & (of_eta > 0.0)  # the anchor's clock is fixed
    squares = np.divide(np.square(state.eta) + of_eta, np.square(deviations), where=is_found, out=np.zeros_like(of_eta))
    result = dict[str, Array]()
    for kind in dict.fromkeys(settings.errors.names):
        of_kind = is_found & settings.errors.are(kind)
        if of_kind.any():
            result[kind] = squares[of_kind]
    if settings.has_offset and state.load is not None:
        total = np.square(state.load[OFFSET]) + variances[unknowns.offset]
        total = total / settings.offset_covariance(body).diagonal()
        for kind, part in (("force_offset", slice(3)), ("torque_offset", slice(3, 6))):
            if _largest(settings, kind) > 0.0:
                result[kind] = total[part]
    if settings.has_gyro_offset:
        gyros = np.square(state.gyros) + variances[unknowns.gyros]
        result["gyro_offset"] = gyros / settings.fused_gyro_offset(body) ** 2
    return result
