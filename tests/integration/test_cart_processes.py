"""Pushers in processes of their own: the same numbers as in one process, and no one is left behind."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from msgspec import structs

from coheft.app.cart.inprocess import run_in_process
from coheft.app.cart.launch import run_in_processes
from coheft.app.cart.table_one import table_one


@pytest.mark.parametrize("pushers", [1, 3])
def test_processes_come_to_the_same_numbers(pushers: int, tmp_path: Path) -> None:
    scenario = structs.replace(table_one(6, pushers=pushers), duration=3.0)
    problems: list[str] = []
    found = run_in_processes(scenario, lambda _: tmp_path, problems.append)
    expected = run_in_process(scenario)
    assert problems == []
    np.testing.assert_array_equal([truth.motion for truth in found.truths], [truth.motion for truth in expected.truths])
    for name, estimates in expected.estimates.items():
        told = {estimate.block: estimate for estimate in found.estimates[name]}
        last = estimates[-1]
        assert told[last.block].cart == last.cart
        assert told[last.block].members == pushers
        np.testing.assert_array_equal(told[last.block].covariance, last.covariance)
