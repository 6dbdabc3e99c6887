"""The choice of another estimator for all robots during a run."""

from msgspec import structs

from coheft.errors import CoheftError
from coheft.wire.scenario.checks import check_scenario
from coheft.wire.scenario.errors import did_you_mean
from coheft.wire.scenario.plugins import usable_in_run
from coheft.wire.scenario.schema import Scenario


def check_choice(estimator: str, used: str, scenario: Scenario) -> None:
    """Check that the robots of a run can change to an estimator from another one that they use.

    Raises:
        ScenarioError: The estimator does not support the scenario.
        CoheftError: It is not available in this run, or in use already.
    """
    available = usable_in_run(scenario.estimator)
    if estimator not in available:
        raise CoheftError(
            f"this run has no estimator {estimator!r}; available: {', '.join(available)}."
            f"{did_you_mean(estimator, available)} A user's estimator has to be the one used from the start"
        )
    if estimator == used:
        raise CoheftError(f"the robots already use the estimator '{estimator}'")
    check_scenario(structs.replace(scenario, estimator=estimator), f"scenario '{scenario.name}'")
