"""Requests in words."""

from __future__ import annotations

import pytest

from coheft.physics_server.request_words import in_words
from coheft.wire.messages.requests import (
    ClockRequest,
    EstimatorRequest,
    HoldRequest,
    InjectRequest,
    PauseRequest,
    RemoveRequest,
    StatusRequest,
    StopRequest,
)
from coheft.wire.messages.structs import Message


@pytest.mark.parametrize(
    ("request_made", "words"),
    [
        (InjectRequest(mass=3.0, position=(0.4, 0.3, -0.1)), "add a load of 3 kg at (0.4, 0.3, -0.1) m"),
        (RemoveRequest(load=7), "remove load 7"),
        (HoldRequest(robot="r2", holding=False), "let r2 release the payload"),
        (HoldRequest(robot="r2", holding=True), "let r2 grasp the payload again"),
        (EstimatorRequest(estimator="fan2017"), "use the estimator 'fan2017'"),
        (PauseRequest(paused=True), "pause the run"),
        (PauseRequest(paused=False), "resume the run"),
        (StopRequest(), "stop the run"),
        (ClockRequest(robot="r2", ahead=0.003), "set the clock of r2 0.003 s ahead"),
        (StatusRequest(), "a request of kind StatusRequest"),
    ],
)
def test_requests_are_told_in_words(request_made: Message, words: str) -> None:
    assert in_words(request_made) == words
