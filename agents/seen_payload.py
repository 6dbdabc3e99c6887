"""What a robot publishes of the load: in its own grasp frame, with its covariance, and only what it has seen."""

from __future__ import annotations

from collections.abc import Callable, Collection
from typing import NamedTuple

from agents.load_moments import HARDLY_MORE
from coheft.estimation.inertia_derivatives import seen_inertia_derivative
from coheft.estimation.inertia_estimate import InertiaEstimate, unseen_quantities
from coheft.estimation.rigid_body import Inertia
from coheft.estimation.spatial import Array
from coheft.estimation.team_registration import TeamPoses
from coheft.wire.messages import PayloadEstimate


class SeenPayload(NamedTuple):
    """What a robot publishes of the load.

    Attributes:
        payload: Mass properties in ``F_i``, None while there are none.
        unseen: What of them is not observable, in words.
    """

    payload: PayloadEstimate | None
    unseen: tuple[str, ...]


class StandingPayload:
    """What was found last, which stands until there is something new to say."""

    def __init__(self) -> None:
        self._objects: tuple[object, ...] = ()
        self._numbers: tuple[float, ...] = ()
        self._count = 0.0
        self.drop()

    def drop(self) -> None:
        """It stands no longer: samples are not what they were."""
        self._found: SeenPayload | None = None

    def find(
        self, count: float, objects: tuple[object, ...], numbers: tuple[float, ...], solve: Callable[[], SeenPayload]
    ) -> SeenPayload:
        """It, or the solution anew.

        Args:
            count: Number of samples that it is to be found from.
            objects: What the solution follows from, and is replaced by another object when it changes.
            numbers: What else it follows from, and what says that such an object has changed in place.
            solve: Finds it.
        """
        is_same = numbers == self._numbers and all(
            one is other for one, other in zip(objects, self._objects, strict=True)
        )
        if self._found is None or not is_same or not self._count <= count <= HARDLY_MORE * self._count:
            self._found, self._count, self._objects, self._numbers = solve(), count, objects, numbers
        return self._found


def seen_payload(
    estimate: InertiaEstimate, by_poses: Array, own: int, team: TeamPoses, inflation: float, size: float
) -> SeenPayload:
    """Mass properties in ``F_i``; and what is not observable.

    Args:
        estimate: In the body frame.
        by_poses: Derivative of ``theta`` by the perturbations of all poses, shape (10, 6 N).
        own: Index of the robot.
        team: All poses and how well they are known.
        inflation: How many times larger the covariance is than all this says.
        size: Of the load, roughly [m].
    """
    pose = team.poses[own]
    derivative = seen_inertia_derivative(pose, estimate.inertia)
    seen_by_poses = derivative[:, 6:] @ estimate.to_central @ by_poses
    seen_by_poses[:, 6 * own : 6 * own + 6] += derivative[:, :6]
    covariance = derivative[:, 6:] @ estimate.covariance @ derivative[:, 6:].T
    covariance += seen_by_poses @ team.covariance @ seen_by_poses.T
    covariance *= inflation
    unseen = unseen_quantities(covariance, estimate.inertia.mass, size)
    inertia = estimate.inertia.carried(pose.inverse())
    sentences = tuple(f"{part.what}: {part.remedy}" for part in unseen)
    return SeenPayload(_published(inertia, covariance, {part.quantity for part in unseen}), sentences)


def _published(inertia: Inertia, covariance: Array, unseen: Collection[str]) -> PayloadEstimate | None:
    """What is seen: inertia is about the centre of mass, and so unseen with it, and both with the mass."""
    if "mass" in unseen:
        return None
    if "com" in unseen:
        return PayloadEstimate(inertia.mass, None, None, covariance[:1, :1])
    if "inertia" in unseen:
        return PayloadEstimate(inertia.mass, inertia.com, None, covariance[:4, :4])
    return PayloadEstimate(inertia.mass, inertia.com, inertia.tensor, covariance)
