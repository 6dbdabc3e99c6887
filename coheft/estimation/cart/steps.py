"""The record of a step of the learner, and that of a change of the load."""

from dataclasses import dataclass, field

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
        corrects_cart: Whether the cart was fast enough to correct its parameters.
        levels: White noise of the measurement in multiples of the stated one, shape (6,).
        before: Belief before the step.
        update: Result of the measurement, once the step is done.
        prediction: Result of the push, once the step is done.
    """

    sighting: Sighting
    push: Push
    corrects_cart: bool
    levels: Array
    before: Belief
    update: Update = field(init=False)
    prediction: Prediction = field(init=False)

    @property
    def surprise(self) -> float:
        """Squared innovation; 0 if the step did not correct the cart, as what casters do is no change of it."""
        return self.update.surprise if self.corrects_cart else 0.0


@dataclass(frozen=True, eq=False)
class Change:
    """A load that has been added or removed."""

    before: Belief
    load: UnknownLoad

    def start(self) -> Belief:
        """Belief after the change."""
        mean, covariance = self.before.mean.copy(), self.before.covariance.copy()
        mean[PHI], covariance[PHI, PHI] = self.load.start()
        return Belief(mean, covariance)
