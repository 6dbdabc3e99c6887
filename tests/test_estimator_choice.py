"""Which estimators may be chosen in mid-run."""

from __future__ import annotations

import msgspec
import pytest

from coheft.errors import CoheftError
from coheft.physics_server.estimator_choice import EstimatorChoice
from coheft.wire.scenario.estimator_settings import SeedSettings
from coheft.wire.scenario.file import load_scenario
from coheft.wire.scenario.schema import Graph


def test_the_built_in_ones_and_the_one_of_the_scenario_may_be_chosen() -> None:
    choice = EstimatorChoice(msgspec.structs.replace(load_scenario("ring3"), estimator="mine"))
    assert (choice.chosen, choice.available) == ("mine", ["efficient", "seed", "mine"])
    choice.choose("seed")
    assert choice.chosen == "seed"


@pytest.mark.parametrize(
    ("estimator", "said"),
    [
        ("best", r"no estimator 'best'; there are: efficient, seed\. One of your own has"),
        ("eficient", r"there are: efficient, seed\. Did you mean 'efficient'\?"),
        ("efficient", "use the estimator 'efficient' already"),
    ],
)
def test_others_are_refused(estimator: str, said: str) -> None:
    choice = EstimatorChoice(load_scenario("ring3"))
    with pytest.raises(CoheftError, match=said):
        choice.choose(estimator)
    assert choice.chosen == "efficient"


def test_what_the_scenario_could_not_begin_with_is_refused() -> None:
    with pytest.raises(CoheftError, match="'carry': found with 'estimator' = 'seed', expected 'efficient'"):
        EstimatorChoice(load_scenario("carry6")).choose("seed")
    ring3 = load_scenario("ring3")
    long = msgspec.structs.replace(
        ring3,
        graph=Graph(kind="line"),
        sensors=msgspec.structs.replace(ring3.sensors, block=200),
        seed_method=SeedSettings(rounds=256),
    )
    with pytest.raises(CoheftError, match=r"'seed_method\.rounds' = 256: messages between neighbours would take up to"):
        EstimatorChoice(long).choose("seed")
