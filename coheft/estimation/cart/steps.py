"""What a learner keeps of each step, and of a load that has come or gone."""

from __future__ import annotations

from dataclasses import dataclass

from coheft.estimation.cart.filter import Belief, Prediction, Push, Sighting, Update
from coheft.estimation.cart.linearisation import PHI
from coheft.estimation.cart.load import UnknownLoad
from coheft.estimation.geometry.spatial import Array


@dataclass(eq=False)
class Step:
    """One step: a measurement, then a push.

    Attributes:
        sighting: The measurement.
        push: The push.
        corrects_cart: Whether the cart was fast enough to learn from.
        levels: How many times its noise is as large as is said, so far as that is new in every sample, shape (6,).
        before: What was believed before it.
        update: What the measurement did.
        prediction: What the push did.
    """

    sighting: Sighting
    push: Push
    corrects_cart: bool
    levels: Array
    before: Belief
    update: Update | None = None
    prediction: Prediction | None = None


@dataclass(frozen=True, eq=False)
class Change:
    """A load has come or gone.

    Attributes:
        before: What was believed before, but for the jolt.
        load: What is known of it.
    """

    before: Belief
    load: UnknownLoad

    def start(self) -> Belief:
        """What is to be believed after it."""
        mean, covariance = self.before.mean.copy(), self.before.covariance.copy()
        mean[PHI], covariance[PHI, PHI] = self.load.start()
        return Belief(mean, covariance)


def surprise(step: Step) -> float:
    """Of a step from which something can be learned; what casters do is no news."""
    return step.update.surprise if step.corrects_cart and step.update is not None else 0.0
