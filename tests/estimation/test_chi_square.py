"""Chi-square quantiles against SciPy's."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.special import chdtrc, chdtri

from coheft.estimation.chi_square import chi_square_threshold, exceedance

FREEDOM = st.integers(1, 400)


@given(freedom=FREEDOM, value=st.floats(0.0, 2000.0))
def test_the_probability_is_exact(freedom, value):
    assert exceedance(value, freedom) == pytest.approx(chdtrc(freedom, value), rel=1e-9, abs=1e-300)


@given(freedom=FREEDOM, exponent=st.floats(-250.0, -0.01))
def test_the_threshold_is_exact_far_out_too(freedom, exponent):
    probability = 10.0**exponent
    assert chi_square_threshold(freedom, probability) == pytest.approx(chdtri(freedom, probability), rel=1e-9)


@pytest.mark.parametrize(("freedom", "probability"), [(0, 0.1), (3, 0.0), (3, 1.0), (3, float("nan"))])
def test_what_there_is_not(freedom, probability):
    with pytest.raises(ValueError, match="expected"):
        chi_square_threshold(freedom, probability)
