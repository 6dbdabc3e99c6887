"""Where the motion does not show the poses, wrenches are judged at those that explain them best."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from coheft.agents.efficient import judge
from coheft.estimation.moments.hidden_poses import best_residuals
from tests.in_process import changed, run_with_faults


@pytest.fixture(scope="module")
def asked() -> list[tuple[Any, ...]]:
    """What the function is called with in a run in which wrenches do not fit at the poses of some fits."""
    found = list[tuple[Any, ...]]()

    def spy(*args: Any) -> Any:
        found.append(args)
        return best_residuals(*args)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(judge, "best_residuals", spy)
        run_with_faults(changed("quiet", duration=2.2, seed=2))
    return found


def test_poses_that_are_not_known_explain_what_internal_forces_leave(asked: list[tuple[Any, ...]]) -> None:
    assert asked
    for estimate, settings, rows in asked:
        best, moved = best_residuals(estimate, settings, rows)
        assert abs(np.square(best).sum() + np.square(moved).sum() - best.size) < 5.0 * np.sqrt(2.0 * best.size)
        assert 0.1 < np.abs(moved).max() < 4.0


def test_numbers_that_are_not_finite_are_returned_as_they_are(asked: list[tuple[Any, ...]]) -> None:
    estimate, settings, rows = asked[0]
    best, _ = best_residuals(estimate, settings, np.full_like(rows, np.nan))
    assert np.isnan(best).all()
