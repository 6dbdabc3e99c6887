"""Smooth steps from 0 to 1, from rest to rest, and their rates; results have the shape of the argument."""

from coheft.estimation.geometry.spatial import Array


def cubic_step(share: Array) -> tuple[Array, Array]:
    """Return value and rate of a step with a continuous rate, at shares of its duration; the rate is per duration."""
    return share * share * (3.0 - 2.0 * share), 6.0 * share * (1.0 - share)


def least_jerk_step(share: Array) -> tuple[Array, Array]:
    """Return value and rate of the step of least jerk (Flash, Hogan 1985), as ``cubic_step``."""
    value = share**3 * (10.0 - 15.0 * share + 6.0 * share**2)
    return value, 30.0 * share**2 * (1.0 - share) ** 2
