"""The estimator that all robots of a run use."""

from __future__ import annotations

from msgspec import structs

from coheft.errors import CoheftError
from coheft.wire.scenario.checks import check_scenario
from coheft.wire.scenario.errors import did_you_mean
from coheft.wire.scenario.plugins import usable_in_run
from coheft.wire.scenario.schema import Scenario


class EstimatorChoice:
    """The scenario's estimator, until the operator selects another one.

    Attributes:
        chosen: Name of the estimator to use from the next block on.
        available: Names of the estimators that may be chosen.
    """

    def __init__(self, scenario: Scenario) -> None:
        self._scenario = scenario
        self.chosen = scenario.estimator
        self.available = usable_in_run(scenario.estimator)

    def choose(self, estimator: str) -> None:
        """Select another estimator.

        Raises:
            ScenarioError: The estimator does not support the scenario.
            CoheftError: It is not available in this run, or in use already.
        """
        if estimator not in self.available:
            raise CoheftError(
                f"this run has no estimator {estimator!r}; available: {', '.join(self.available)}."
                f"{did_you_mean(estimator, self.available)} A user's estimator has to be the one used from the start"
            )
        if estimator == self.chosen:
            raise CoheftError(f"the robots already use the estimator '{estimator}'")
        scenario = structs.replace(self._scenario, estimator=estimator)
        check_scenario(scenario, f"scenario '{scenario.name}'")
        self.chosen = estimator
