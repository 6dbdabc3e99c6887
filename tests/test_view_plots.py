"""Curves of the view, as they are handed to the browser."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

pytest.importorskip("viser", reason="the view needs viser: install 'coheft[view]'")

from coheft.app.view.model import ViewModel
from coheft.app.view.plots import Plots
from tests.synthetic_run import HEAVY, LIGHT, STD, estimate, truth
from tests.test_view_model import STATUS


def test_nothing_is_drawn_across_times_at_which_nothing_is_known() -> None:
    """The browser would join the points on both sides of a NaN."""
    shown: list[Any] = []
    gui = SimpleNamespace(add_uplot=lambda *data, **options: shown.append((data, SimpleNamespace())) or shown[-1][1])
    plots = Plots(cast(Any, SimpleNamespace(gui=gui)), [STATUS.estimator])
    model = ViewModel(STATUS)
    for block, payload in enumerate((HEAVY, None, None, HEAVY)):
        model.receive(truth(block, LIGHT))
        model.receive(estimate("r1", block, payload))
    plots.draw(model.traces["r1"], model.record.time)
    (_, series), mass = shown[0]
    assert [line["width"] for line in series[3:]] == [0], "errors are points"
    _, band, below, error = mass.data
    assert np.isfinite(error).tolist() == [True, False, False, True]
    assert band[[0, 3]] == pytest.approx(3.0 * STD[0])
    assert (band[1:3] > mass.scales["y"]["range"][1]).all()
    np.testing.assert_array_equal(below, -band)
