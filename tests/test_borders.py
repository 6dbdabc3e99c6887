"""When something that may come at any time takes effect."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from coheft.wire.scenario.borders import by_border, first_border
from coheft.wire.scenario.schema import LoadChange


@given(st.integers(0, 10**6), st.sampled_from([50, 100, 250, 500, 1000]))
def test_times_at_borders_are_not_late_by_rounding(border: int, rate: int) -> None:
    duration = 1.0 / rate
    for time in (border / rate, border * duration, round(border * duration, 9)):
        assert first_border(time, duration) == border


def test_what_comes_between_borders_waits_for_the_next() -> None:
    assert [first_border(time, 0.02) for time in (0.0, 0.001, 0.0199, 0.0201)] == [0, 1, 1, 2]


def test_what_takes_effect_at_one_border_does_so_in_the_order_of_its_times() -> None:
    late, early = LoadChange(at=0.019, mass=1.0), LoadChange(at=0.011, mass=2.0)
    assert by_border([late, early], 0.02) == {1: [early, late]}
