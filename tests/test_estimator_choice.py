"""Which estimators may be chosen in mid-run."""

from __future__ import annotations

import msgspec
import pytest

from coheft.errors import CoheftError
from coheft.physics_server.estimator_choice import check_choice
from coheft.wire.scenario.estimator_settings import Fan2017Settings
from coheft.wire.scenario.file import load_scenario
from coheft.wire.scenario.schema import Graph


def test_the_built_in_ones_and_the_one_of_the_scenario_may_be_chosen() -> None:
    scenario = msgspec.structs.replace(load_scenario("ring3"), estimator="mine")
    check_choice("fan2017", "mine", scenario)


@pytest.mark.parametrize(
    ("estimator", "said"),
    [
        ("best", r"no estimator 'best'; available: efficient, fan2017\. A user's estimator has"),
        ("eficient", r"available: efficient, fan2017\. Did you mean 'efficient'\?"),
        ("efficient", "already use the estimator 'efficient'"),
    ],
)
def test_others_are_refused(estimator: str, said: str) -> None:
    with pytest.raises(CoheftError, match=said):
        check_choice(estimator, "efficient", load_scenario("ring3"))


def test_what_the_scenario_could_not_begin_with_is_refused() -> None:
    with pytest.raises(CoheftError, match="'carry': found with 'estimator' = 'fan2017', expected 'efficient'"):
        check_choice("fan2017", "efficient", load_scenario("carry6"))
    ring3 = load_scenario("ring3")
    long = msgspec.structs.replace(
        ring3,
        graph=Graph(kind="line"),
        sensors=msgspec.structs.replace(ring3.sensors, block=200),
        fan2017=Fan2017Settings(rounds=256),
    )
    with pytest.raises(CoheftError, match=r"'fan2017\.rounds' = 256: messages between neighbours would take up to"):
        check_choice("fan2017", "efficient", long)
