"""A step of the mass that may have occurred unnoticed makes poses less certain, not only the load."""

from __future__ import annotations

import numpy as np
import pytest

from coheft.agents.efficient.knowledge import Knowledge
from coheft.agents.efficient.unnoticed import Unnoticed, UnnoticedStep
from coheft.estimation.moments.change import SmallStep
from coheft.estimation.rigid_body.mass_properties import point_mass
from tests.efficient.rows import LOAD, POSES, made_up_rows
from tests.efficient.sessions import fed, largest_error

ROWS = 120


def known() -> Knowledge:
    return fed(made_up_rows(ROWS))._known


def test_a_step_is_halved_by_each_look_that_finds_none_and_replaced_by_a_larger_one() -> None:
    first = UnnoticedStep().after_test(SmallStep(0, 0.1), 60, 0.5)
    faded = first.after_test(SmallStep(0, 0.0), 0, 0.5)
    assert faded == UnnoticedStep(0.05, 60)
    still = faded.after_test(SmallStep(0, 0.02), 70, 0.5)
    assert still == UnnoticedStep(0.025, 60)
    assert still.after_test(SmallStep(0, 0.02), 80, 0.5) == UnnoticedStep(0.02, 80)


@pytest.mark.parametrize(("first", "are_wrong"), [(60, True), (0, False), (ROWS, False)])
def test_poses_are_less_certain_if_they_were_fitted_to_rows_before_and_after_a_step(
    first: int, are_wrong: bool
) -> None:
    found = known()
    estimate = found.fit()
    covered = Unnoticed(UnnoticedStep(0.5, first)).cover(found, estimate)
    unknowns = estimate.body.unknowns
    more = covered.covariance.diagonal() / np.maximum(estimate.covariance.diagonal(), 1e-30)
    assert more[unknowns.theta.start] > 10.0
    assert (more[unknowns.poses].max() > 1.5) == are_wrong
    assert np.linalg.eigvalsh(covered.covariance).min() > -1e-12


def test_with_the_next_load_poses_do_not_keep_what_a_step_has_made_wrong() -> None:
    loads = [LOAD + mass * point_mass(np.array([-0.2, -0.1, 0.1])) for mass in (0.0, 0.6, 2.0)]
    first, second, third = (
        made_up_rows(count, load, start) for count, load, start in zip((60, 40, 40), loads, (0, 60, 100), strict=True)
    )

    def largest_error_of_poses(mass: float) -> float:
        session = fed(first)
        found = session._known
        for number, row in enumerate(second, 60):
            found.buffer.add(number, row)
        before = found.fit()
        step = UnnoticedStep(mass, 60).before_change(found, before, 100)
        found.forget_load(before, 100, True, 15, step)
        for number, row in enumerate(third, 100):
            found.buffer.add(number, row)
        found.fit()
        return largest_error(session, POSES, loads[2][0])

    assert largest_error_of_poses(0.6) < 4.0
    assert largest_error_of_poses(0.0) > 6.0
