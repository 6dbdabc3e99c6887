"""Over how long samples are summed."""

from __future__ import annotations

import pytest

from coheft.estimation.batch.statistics import span_length


@pytest.mark.parametrize(
    ("count", "unknowns", "expected"), [(81, 1, 20), (800, 10, 20), (79, 1, 19), (12, 1, 3), (400, 10, 10), (2, 1, 1)]
)
def test_there_are_some_sums_of_every_recording(count: int, unknowns: int, expected: int) -> None:
    assert span_length(count, 20.0, unknowns) == expected
