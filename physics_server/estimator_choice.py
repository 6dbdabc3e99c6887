"""Which estimator all robots of a run use."""

from __future__ import annotations

from msgspec import structs

from coheft.errors import CoheftError
from coheft.wire.scenario.checks import check_scenario
from coheft.wire.scenario.errors import did_you_mean
from coheft.wire.scenario.plugins import usable_in_run
from coheft.wire.scenario.schema import Scenario


class EstimatorChoice:
    """The scenario's own estimator, until the operator chooses another one.

    Args:
        scenario: What is run.

    Attributes:
        chosen: The one to use from the next block on.
        available: Those that may be chosen.
    """

    def __init__(self, scenario: Scenario) -> None:
        self._scenario = scenario
        self.chosen = scenario.estimator
        self.available = usable_in_run(scenario.estimator)

    def choose(self, estimator: str) -> None:
        """Choose another one.

        Raises:
            ScenarioError: It cannot do what the scenario asks of the robots.
            CoheftError: The robots of this run do not have it, or use it already.
        """
        if estimator not in self.available:
            raise CoheftError(
                f"this run has no estimator {estimator!r}; there are: {', '.join(self.available)}."
                f"{did_you_mean(estimator, self.available)} One of your own has to be the one that the run begins with"
            )
        if estimator == self.chosen:
            raise CoheftError(f"the robots use the estimator '{estimator}' already")
        scenario = structs.replace(self._scenario, estimator=estimator)
        check_scenario(scenario, f"scenario '{scenario.name}'")
        self.chosen = estimator
