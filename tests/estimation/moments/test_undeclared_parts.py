"""Parts of information for tests of undeclared errors, against evidence with these errors among the unknowns."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from coheft.estimation.moments.chapter import EvidenceAt
from coheft.estimation.moments.fit_settings import FitSettings
from coheft.estimation.moments.likelihood import Derivatives
from coheft.estimation.moments.sensor_errors import KINDS, SensorErrors
from coheft.estimation.moments.undeclared import KINDS_OF_ONE_ROBOT, _Tests, undeclared_error
from coheft.estimation.moments.unknowns import State
from tests.estimation.moments.fitting import fit
from tests.estimation.moments.moving_team import ERRORS, EXACT, LATE_AND_LIMP, NOISE, PERIOD, make_team, noisy_for

PARTLY = SensorErrors({"gyro_mounting": 0.01}, {"clock": 0.001}, {})


@pytest.mark.parametrize(
    "errors", [EXACT, ERRORS, LATE_AND_LIMP, PARTLY], ids=["exact", "errors", "late and limp", "partly"]
)
def test_parts_are_those_of_the_whole(errors: SensorErrors) -> None:
    settings, team = FitSettings(NOISE, PERIOD, errors), make_team(3, number=60)
    team = team.expressed_in(team.poses[0])
    found = fit(noisy_for(errors, team, np.random.default_rng(3)), settings)
    body = found.estimate.body
    moments = found.chapter.evaluation()(body)
    tests = _Tests.of_robots(found.estimate.derivatives, KINDS_OF_ONE_ROBOT, moments)

    every = SensorErrors(dict.fromkeys((*KINDS_OF_ONE_ROBOT, *errors.names), 1.0))
    own, state = every.are(*errors.names), found.estimate.state
    eta = np.zeros((3, every.count))
    calibration = every.step(eta) if state.calibration is None else state.calibration
    whole = replace(settings, errors=every).body(State(state.poses, eta, calibration, state.gyros, state.load))
    evidence, unknowns = EvidenceAt(Derivatives(whole)).of(found.chapter.evaluation()(whole)), whole.unknowns
    by_robot = np.hstack([unknowns.poses, unknowns.eta[:, own]])
    others = np.concatenate([by_robot.ravel(), np.arange(unknowns.gyros.start, unknowns.size)])

    deviations = body.unknowns.deviations
    expected = [
        (robot, kind)
        for robot in range(3)
        for kind in KINDS
        if kind in KINDS_OF_ONE_ROBOT and not deviations[robot, errors.are(kind)].any()
    ]
    assert tests.errors == expected
    for k, (robot, kind) in enumerate(expected):
        tested = unknowns.eta[robot, every.are(kind)]
        unit = np.sqrt(evidence.information[tested, tested])
        units = np.sqrt(np.maximum(evidence.information[others, others], 1e-6))
        np.testing.assert_allclose(tests.score[k] / unit, evidence.score[tested] / unit, atol=1e-8)
        for part, own_part, all_of in (
            (tests.information, tests.own_information, evidence.information),
            (tests.noise, tests.own_noise, evidence.noise),
        ):
            both, alone = np.outer(unit, units), np.outer(unit, unit)
            np.testing.assert_allclose(part[k] / both, all_of[np.ix_(tested, others)] / both, atol=1e-9)
            np.testing.assert_allclose(own_part[k] / alone, all_of[np.ix_(tested, tested)] / alone, atol=1e-9)


def test_where_all_errors_are_declared_there_is_nothing_to_test() -> None:
    errors = SensorErrors(dict.fromkeys(KINDS_OF_ONE_ROBOT, 0.01))
    settings = FitSettings(NOISE, PERIOD, errors, force_offset=1.0, torque_offset=0.05, gyro_offset=0.005)
    team = make_team(3, number=60)
    team = team.expressed_in(team.poses[0])
    found = fit(noisy_for(errors, team, np.random.default_rng(3)), settings)
    assert undeclared_error(found.estimate, found.chapter, settings, 0, KINDS_OF_ONE_ROBOT, 1e-9) is None
