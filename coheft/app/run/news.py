"""Checks of an observer's received messages: computing with a checked message cannot fail."""

from collections.abc import Collection

import numpy as np

from coheft.errors import MessageError, one_line
from coheft.estimation.measurement import SAMPLE_SIZE
from coheft.estimation.tolerance import AXES, PAIRS, SensorTolerance
from coheft.wire.messages.codec import check_choice, check_field, check_number, check_numbers
from coheft.wire.messages.estimate_checks import ROTATION_TOLERANCE, check_payload, check_pose, check_rotation
from coheft.wire.messages.requests import Status
from coheft.wire.messages.structs import Estimate, EstimateBeside, Message, Problem
from coheft.wire.messages.truth import Scene, Truth
from coheft.wire.scenario.schema import MAX_DURATION
from coheft.wire.transport.planes import SERVER

_LONGEST = 2 * MAX_DURATION
"""Largest time of a block [s]; the last block may end a little later than the run."""

News = Truth | Estimate | EstimateBeside | Problem
"""Messages that an observer receives about a run."""


def check_news(source: str, message: Message, scene: Scene) -> News | None:
    """Return a checked message of a source, or raise a ``MessageError``; None if it is not for observers."""
    match message:
        case Truth():
            check_truth(message, scene)
            return message
        case Estimate():
            check_estimate(message, source, scene.robots)
            return message
        case EstimateBeside(estimate=estimate):
            check_estimate(estimate, source, scene.robots)
            return message
        case Problem():
            is_end = message.is_end and source == SERVER
            return Problem(source=source, text=one_line(message.text), is_end=is_end)
    return None


def check_status(status: Status) -> None:
    """Check a status: robots, graph, grasps, shapes and estimators, or raise a ``MessageError``."""
    scene = status.scene
    if not 0 < len(set(scene.robots)) == len(scene.robots):
        raise MessageError(f"robots are {scene.robots} but expected at least one, without duplicates")
    check_numbers(scene.rotations, (len(scene.robots), 3, 3), "rotations")
    for name, rotation in zip(scene.robots, scene.rotations, strict=True):
        check_rotation(rotation, name)
    check_numbers(scene.translations, (len(scene.robots), 3), "translations")
    if scene.triangles.size:
        check_numbers(scene.triangles.astype(np.float64), (len(scene.triangles), 3, 3), "triangles")
    check_field("robots of the graph", sorted(scene.neighbours), sorted(scene.robots))
    for name, others in scene.neighbours.items():
        for other in others:
            check_choice(f"neighbour of {name!r}", other, scene.robots)
    check_choice("estimator", status.estimator, status.estimators)
    for value in (
        *scene.home,
        *(number for box in scene.boxes for number in (*box.size, *box.position, *box.rotation_deg)),
    ):
        check_number(value, "a number of the scene")


def check_truth(truth: Truth, scene: Scene) -> None:
    """Check a truth about this team, received from the server, or raise a ``MessageError``."""
    _check_moment(truth.block, truth.time)
    payload = truth.payload
    check_number(payload.mass, "mass")
    if payload.mass <= 0.0:
        raise MessageError(f"mass is {payload.mass} kg but expected more than 0")
    check_numbers(payload.com, (3,), "com")
    check_numbers(payload.tensor, (3, 3), "tensor")
    if not payload.tensor.any():
        raise MessageError("tensor is zero but expected that of a body")
    check_numbers(truth.position, (3,), "position")
    check_numbers(truth.quaternion, (4,), "quaternion")
    if abs(np.linalg.norm(truth.quaternion) - 1.0) > ROTATION_TOLERANCE:
        raise MessageError(f"quaternion is {truth.quaternion.tolist()} but expected one of length 1")
    check_numbers(truth.total_wrench, (6,), "total_wrench")
    check_numbers(truth.samples, (len(scene.robots), SAMPLE_SIZE), "samples")
    for name, grasp in truth.slipped.items():
        check_choice("robot whose grasp has slipped", name, scene.robots)
        check_rotation(grasp.rotation, name)
        check_numbers(grasp.translation, (3,), "translation")
    for name, ahead in truth.clocks.items():
        check_choice("robot whose clock is set", name, scene.robots)
        check_number(ahead, "a clock")
    for load in truth.loads:
        for value in (load.mass, *load.position, *load.size, load.leak):
            check_number(value, f"a number of load {load.id}")


def check_estimate(estimate: Estimate, source: str, robots: Collection[str]) -> None:
    """Check an estimate of one of the robots, received from the source, or raise a ``MessageError``."""
    check_field("robot", estimate.robot, source)
    check_choice("robot", estimate.robot, robots)
    _check_moment(estimate.block, estimate.time)
    check_numbers(estimate.total_wrench, (6,), "total_wrench")
    if estimate.total_block > estimate.block:
        raise MessageError(f"total_block is {estimate.total_block} but expected at most {estimate.block}, the block")
    if estimate.payload is not None:
        check_payload(estimate.payload)
    for name, pose in estimate.poses.items():
        check_choice("robot of a pose", name, robots)
        check_pose(pose, name)
    for notice in estimate.load_changes:
        check_number(notice.noticed_at, "noticed_at")
    for slip in estimate.slips:
        check_choice("robot whose grasp has slipped", slip.robot, robots)
        check_numbers(np.array([slip.noticed_at, slip.named_at, slip.slipped_at]), (3,), "a slip")
    for name in (*estimate.silent, *estimate.disturbed):
        check_choice("robot that is silent, or whose link is disturbed", name, robots)
    for error in estimate.sensor_errors:
        check_choice("key of a sensor's error", error.key, SensorTolerance.__struct_fields__)
        check_choice("axis of a sensor's error", error.axis, ("", *AXES, *PAIRS))
        check_numbers(np.array([error.value, error.std, error.told]), (3,), "a sensor's error")
    for text in (*estimate.reasons, *estimate.not_observable, estimate.estimator):
        check_field("text in one line", text, one_line(text))


def _check_moment(block: int, time: float) -> None:
    check_number(time, "time")
    if block < 0 or not 0.0 < time <= _LONGEST:
        raise MessageError(
            f"block is {block}, which ends at {time} s, but expected a time between 0 and {_LONGEST:g} s"
        )
