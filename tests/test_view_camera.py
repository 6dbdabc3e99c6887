"""The camera of a browser that opens the view."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from coheft.app.view.geometry import whole_team

stage = pytest.importorskip("coheft.app.view.stage", reason="the view needs viser: install 'coheft[view]'")

MIDDLE, SIZE, PHONE = np.array([0.1, 0.0, 1.0]), 0.8, 390 / 844


class Camera:
    """A browser's camera as the server sees it; ``say`` is what the browser reports."""

    aspect = PHONE
    position = look_at = np.zeros(3)

    def on_update(self, act: Callable[[object], None]) -> None:
        self._act = act

    def say(self, look_at: Any, position: Any) -> None:
        self.look_at, self.position = look_at, position
        self._act(self)


def test_a_browser_that_takes_the_first_camera_of_the_server_late_shows_all_robots_again() -> None:
    camera = Camera()
    stage.show_whole_team(camera, MIDDLE, SIZE)
    look_at, position = whole_team(MIDDLE, SIZE, PHONE)
    np.testing.assert_allclose([camera.look_at, camera.position], [look_at, position])
    camera.say(*whole_team(MIDDLE, SIZE, 1.0))
    np.testing.assert_allclose([camera.look_at, camera.position], [look_at, position])


def test_a_camera_that_the_user_has_moved_stays_there() -> None:
    camera = Camera()
    stage.show_whole_team(camera, MIDDLE, SIZE)
    camera.say(MIDDLE, MIDDLE + [1.0, 1.0, 1.0])
    np.testing.assert_allclose([camera.look_at, camera.position], [MIDDLE, MIDDLE + [1.0, 1.0, 1.0]])
