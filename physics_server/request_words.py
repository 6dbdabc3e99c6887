"""Descriptions of requests to the server, for the log and for messages."""

from coheft.wire.messages.requests import (
    ClockRequest,
    EstimatorRequest,
    HoldRequest,
    InjectRequest,
    PauseRequest,
    RemoveRequest,
    StopRequest,
)
from coheft.wire.messages.structs import Message


def in_words(request: Message) -> str:
    """Describe a request in a few words."""
    match request:
        case InjectRequest(mass=mass, position=(x, y, z)):
            return f"add a load of {mass:g} kg at ({x:g}, {y:g}, {z:g}) m"
        case RemoveRequest(load=load):
            return f"remove load {load}"
        case HoldRequest(robot=robot, holding=holding):
            return f"let {robot} {'grasp the payload again' if holding else 'release the payload'}"
        case EstimatorRequest(estimator=estimator):
            return f"use the estimator {estimator!r}"
        case PauseRequest(paused=paused):
            return "pause the run" if paused else "resume the run"
        case ClockRequest(robot=robot, ahead=ahead):
            return f"set the clock of {robot} {ahead:g} s ahead"
        case StopRequest():
            return "stop the run"
    return f"a request of kind {type(request).__name__}"
