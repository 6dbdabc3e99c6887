"""Estimates that a robot publishes of the payload, with covariances and the reasons that keep these large."""

import numpy as np

from coheft.agents.estimator import is_converged
from coheft.agents.fan2017.agreement import Agreed
from coheft.estimation.fan2017.joint_rls import JointRls
from coheft.estimation.geometry.spatial import Array
from coheft.estimation.linear_algebra import inverse
from coheft.estimation.rigid_body.consistency import is_possible, nearest_possible
from coheft.estimation.rigid_body.derivatives import barycentric_derivative
from coheft.estimation.rigid_body.mass_properties import Inertia, unpack_symmetric
from coheft.wire.messages.structs import PayloadEstimate
from coheft.wire.scenario.estimator_settings import Converged

_ORDER = [9, 6, 7, 8, 0, 1, 2, 3, 4, 5]
"""Of theta ``(J, h, 1/m)``, to get ``(m, h, J)``."""


def claim(
    rls: JointRls, agreed: Agreed, share: Array | None, by_poses: Array, length: float, limits: Converged
) -> tuple[PayloadEstimate, tuple[str, ...]]:
    """Return the payload with its covariance, and why that is larger than the limits allow.

    Args:
        rls: The own estimate.
        agreed: That of all robots.
        share: ``MeanNoise.share``; None if the own estimate is published.
        by_poses: What frozen poses add to the covariance of theta, shape (10, 10).
        length: Typical distance of grasps [m].
        limits: When an estimate is good enough.

    Returns:
        The likeliest body that can exist, in ``F_i``, with the covariance of ``(m, h, J)`` [kg, m, kg·m²] in this
        order, J packed and about the centre of mass, shape (10, 10); and in words the causes whose standard deviations
        exceed the limits, none if the estimate is within them.
    """
    values = agreed.theta[_ORDER]
    values[0] = 1.0 / values[0]
    parts = {
        "noise": rls.covariance(share),
        "poses that are frozen as they were when the sums began": by_poses,
        "dynamic consensus, which lags behind": np.outer(agreed.by_lag, agreed.by_lag),
        "samples of the load before it changed, which still count": np.outer(agreed.by_old, agreed.by_old)
        + rls.covariance_of_old,
        "robots that do not agree yet": np.outer(agreed.behind, agreed.behind),
    }
    covariances = {cause: _in_order(part, values[0]) for cause, part in parts.items()}
    covariance = np.sum(list(covariances.values()), axis=0)
    raw = Inertia(float(values[0]), values[1:4], unpack_symmetric(values[4:]))
    inertia = likeliest_body(raw, covariance, length)
    payload = PayloadEstimate(inertia.mass, inertia.com, inertia.tensor, covariance)
    if is_converged(payload, limits):
        return payload, ()
    alone = [
        cause
        for cause, part in covariances.items()
        if not is_converged(PayloadEstimate(inertia.mass, inertia.com, inertia.tensor, part), limits)
    ]
    return payload, tuple(f"standard deviations are too large because of {cause}" for cause in alone or covariances)


def _in_order(covariance: Array, mass: float) -> Array:
    """Of ``(m, h, J)``, from that of theta."""
    result = covariance[np.ix_(_ORDER, _ORDER)]
    result[0] *= -(mass**2)
    result[:, 0] *= -(mass**2)
    return result


def likeliest_body(raw: Inertia, covariance: Array, length: float) -> Inertia:
    """The likeliest body that can exist: no robot is to be told of one that cannot.

    Args:
        raw: Estimate that need not be possible.
        covariance: Of its ``(m, h, J)``, shape (10, 10).
        length: Rough size of the body [m].
    """
    parameters = raw.barycentric()
    if is_possible(parameters):
        return raw
    deviations = np.sqrt(covariance.diagonal())  # kg, m and kg·m² differ by much
    to_raw = inverse(barycentric_derivative(raw)) / deviations[:, None]
    information = to_raw.T @ inverse(covariance / np.outer(deviations, deviations)) @ to_raw
    return Inertia.from_barycentric(nearest_possible(parameters, information, length))
