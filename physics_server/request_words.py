"""What somebody asked of the server, for its log and for people."""

from __future__ import annotations

from coheft.wire.messages.requests import (
    EstimatorRequest,
    HoldRequest,
    InjectRequest,
    PauseRequest,
    RemoveRequest,
    StopRequest,
)
from coheft.wire.messages.structs import Message


def in_words(request: Message) -> str:
    """The request in a few words."""
    match request:
        case InjectRequest(mass=mass, position=(x, y, z)):
            return f"put {mass:g} kg onto the payload at ({x:g}, {y:g}, {z:g}) m"
        case RemoveRequest(load=load):
            return f"take load {load} away"
        case HoldRequest(robot=robot, holding=holding):
            return f"let {robot} {'take hold again' if holding else 'let go'}"
        case EstimatorRequest(estimator=estimator):
            return f"use the estimator {estimator!r}"
        case PauseRequest(paused=paused):
            return "pause the run" if paused else "let the run go on"
        case StopRequest():
            return "stop the run"
    return f"a request of kind {type(request).__name__}"
