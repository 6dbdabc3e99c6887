"""Small changes of the load in the first second, while poses and errors of sensors may explain them as well."""

from __future__ import annotations

import numpy as np
import pytest

from coheft.agents.efficient.session import Session
from coheft.agents.efficient.settings import Guards
from coheft.estimation.measurement import SensorNoise
from coheft.estimation.moments.fit_settings import FitSettings
from coheft.estimation.moments.rows import RowNoise
from coheft.estimation.moments.sensor_errors import SensorErrors
from coheft.estimation.rigid_body.mass_properties import point_mass
from tests.efficient.rows import LOAD, PERIOD, POSES, made_up_rows

TOLERANCES = {
    **dict.fromkeys(("force_scale", "torque_scale", "acceleration_scale"), 0.005),
    **dict.fromkeys(("acceleration_mounting", "velocity_mounting", "gyro_mounting"), 0.009),
    "acceleration_bias": 0.05,
}
SETTINGS = FitSettings(
    RowNoise.of_samples(SensorNoise(), 20, 1000.0),
    PERIOD,
    errors=SensorErrors(TOLERANCES),
    force_offset=1.0,
    torque_offset=0.05,
    gyro_offset=0.005,
)


@pytest.mark.parametrize(
    ("before", "seed", "first", "noticed"),
    [
        pytest.param(40, 4, 40, 59, id="rows-of-both-loads-hide-where-it-was"),
        pytest.param(30, 4, 30, 38, id="rows-of-the-other-load-were-fitted"),
        pytest.param(40, 0, 40, 44, id="fits-hide-what-was-nearly-detected"),
        pytest.param(30, 1, 54, 63, id="fits-hide-what-is-looked-for-too-late"),
    ],
)
def test_one_per_cent_more_is_noticed(before: int, seed: int, first: int, noticed: int) -> None:
    heavier = LOAD + 0.01 * LOAD[0] * point_mass(np.array([-0.2, -0.1, 0.1]))
    parts = made_up_rows(before, seed=seed), made_up_rows(80, load=heavier, first=before, seed=seed)
    session = Session(len(POSES), 0, SETTINGS, Guards())
    for number, row in enumerate(np.concatenate(parts)):
        session.take(number, row)
    assert session.causes.changes
    found = session.causes.changes[0]
    assert found.first <= first
    assert found.noticed <= noticed + 2
