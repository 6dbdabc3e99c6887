"""Several estimators of one robot, side by side on the same measurements.

The first one is the robot's own: its estimates are published, and move the arm. The others' estimates are reported
beside it. Their messages travel in one, in arrays named ``estimator/array``.
"""

from collections.abc import Callable, Mapping
from functools import partial
from typing import Any, TypeVar

import numpy.typing as npt

from coheft.agents.estimator import Belief, Channels, Estimator, RowSigner, SignsRows, TakesLate
from coheft.errors import PluginError
from coheft.estimation.measurement import MeasurementBlock

T = TypeVar("T")


class SideBySide:
    """Estimators that neither know nor influence each other, the robot's own first. See ``Estimator``.

    A user's estimator that fails is not stepped any more, and gives that as its doubt; the others continue.
    """

    def __init__(self, estimators: Mapping[str, Estimator]) -> None:
        self._first = next(iter(estimators))
        self._estimators = dict(estimators)
        self._failures: dict[str, str] = {}

    def step(
        self, index: int, own: MeasurementBlock | None, inbox: Mapping[str, Channels]
    ) -> dict[str, npt.NDArray[Any]]:
        """See ``Estimator.step``."""
        sent: dict[str, npt.NDArray[Any]] = {}
        nothing: dict[str, npt.NDArray[Any]] = {}
        parts = {sender: self._readable(_by_estimator(channels)) for sender, channels in inbox.items()}
        for name, estimator in self._estimators.items():
            received = {sender: each[name] for sender, each in parts.items() if name in each}
            channels = self._try(name, lambda: estimator.step(index, own, received), nothing)  # noqa: B023
            sent |= {f"{name}/{array}": value for array, value in channels.items()}
        return sent

    def fits(self, channels: Channels) -> bool:
        """See ``Estimator.fits``: whether the arrays are of these estimators, and any can read its own."""
        received = _by_estimator(channels)
        return received.keys() <= self._estimators.keys() and bool(self._readable(received))

    def belief(self) -> Belief:
        """Return the estimate of the robot's own estimator."""
        return self.belief_of(self._first)

    def doubts(self) -> tuple[str, ...]:
        """Return the doubts of the robot's own estimator."""
        return self.doubts_of(self._first)

    def belief_of(self, name: str) -> Belief:
        """Return the estimate of one of the estimators."""
        return self._try(name, self._estimators[name].belief, Belief("poses", converged=False, payload=None, poses={}))

    def doubts_of(self, name: str) -> tuple[str, ...]:
        """Return the doubts of one of the estimators, or that it has failed."""
        no_doubts: tuple[str, ...] = ()
        doubts = self._try(name, self._estimators[name].doubts, no_doubts)
        return (self._failures[name],) if name in self._failures else doubts

    def receive_late(self, sender: str, channels: Channels) -> None:
        """See ``TakesLate``."""
        for name, part in self._readable(_by_estimator(channels)).items():
            estimator = self._estimators[name]
            if isinstance(estimator, TakesLate):
                estimator.receive_late(sender, part)

    def sign_with(self, signer: RowSigner) -> None:
        """See ``SignsRows``."""
        for estimator in self._signing:
            estimator.sign_with(signer)

    def refused(self) -> list[str]:
        """See ``SignsRows``."""
        return [text for estimator in self._signing for text in estimator.refused()]

    @property
    def _signing(self) -> list[SignsRows]:
        return [estimator for estimator in self._estimators.values() if isinstance(estimator, SignsRows)]

    def _readable(self, received: Mapping[str, Channels]) -> dict[str, Channels]:
        """Return the arrays of the estimators that can read theirs, by estimator; a message may hold none of them."""
        parts = {name: received.get(name, {}) for name in self._estimators}
        can_read = {name: partial(each.fits, parts[name]) for name, each in self._estimators.items()}
        return {name: part for name, part in parts.items() if self._try(name, can_read[name], False)}

    def _try(self, name: str, call: Callable[[], T], otherwise: T) -> T:
        """Call an estimator unless it has failed, and note if it fails now."""
        if name in self._failures:
            return otherwise
        try:
            return call()
        except PluginError as error:
            self._failures[name] = str(error)
            return otherwise


def _by_estimator(channels: Channels) -> dict[str, dict[str, npt.NDArray[Any]]]:
    """Return the arrays of a message by estimator, under their own names."""
    result: dict[str, dict[str, npt.NDArray[Any]]] = {}
    for array, value in channels.items():
        name, _, own = array.partition("/")
        result.setdefault(name, {})[own] = value
    return result
