"""Checks of the values that a user's estimator returns, and their conversion to plain types.

The results are what other processes would receive: copies, so that later changes by the estimator have no effect, of
numbers that messages can hold. So a team in one process behaves like one in many processes.
"""

import operator
from collections.abc import Callable, Collection, Mapping
from typing import Any, TypeVar

import msgspec
import numpy as np

from coheft.agents.estimator import Belief
from coheft.agents.inbox import LARGEST_NORM, can_be_used
from coheft.errors import MessageError, one_line
from coheft.estimation.geometry.spatial import Array, Pose
from coheft.estimation.geometry.uncertain_pose import UncertainPose
from coheft.wire.messages.codec import check_choice, check_number, check_numbers
from coheft.wire.messages.estimate_checks import check_payload, check_pose
from coheft.wire.messages.frame import MAX_DIMENSIONS
from coheft.wire.messages.structs import (
    LoadChangeNotice,
    PayloadEstimate,
    PoseEstimate,
    SensorErrorEstimate,
    SlipNotice,
)

_PER_ARRAY = 32
"""Upper bound of the bytes per array in a message, besides its name and its numbers."""

T = TypeVar("T")
S = TypeVar("S", LoadChangeNotice, SensorErrorEstimate, SlipNotice)


def plain_channels(returned: object, largest: int) -> dict[str, Array]:
    """Convert the return value of ``Estimator.step`` to arrays of float64, which fit into a message of ``largest`` [B].

    Raises:
        MessageError: Neighbours could not use it; the text says what to do.
    """
    if not isinstance(returned, Mapping):
        raise MessageError(f"it is {_kind(returned)}, expected a dict of arrays by name; to send nothing, return {{}}")
    channels = {name: _plain_channel(name, value) for name, value in returned.items()}
    size = sum(len(name.encode()) + _PER_ARRAY + array.nbytes for name, array in channels.items())
    if size > largest:
        raise MessageError(
            f"its arrays take {_kilobytes(size)}, expected at most {_kilobytes(largest)}, because neighbours drop "
            f"larger messages: send a part after each block"
        )
    return channels


def _plain_channel(name: object, value: object) -> Array:
    if not isinstance(name, str):
        raise MessageError(f"the name {name!r} of an array is {_kind(name)}, expected text")
    place = f"the array {name!r}"
    array = plain_array(value, place)
    if array.ndim > MAX_DIMENSIONS:
        raise MessageError(f"{place} has {array.ndim} dimensions, expected at most {MAX_DIMENSIONS}: reshape it")
    unusable = array.size - np.count_nonzero(np.isfinite(array))
    if unusable:
        raise MessageError(
            f"{place} contains {unusable} numbers that are not finite, expected finite ones only: leave out "
            f"unknown values"
        )
    if not can_be_used(array):
        raise MessageError(f"{place} has a norm of at least {LARGEST_NORM:g}, expected a smaller one: use other units")
    return array


def plain_answer(returned: object) -> bool:
    """Convert the return value of ``Estimator.fits``, or raise a ``MessageError`` if it is neither True nor False."""
    if not isinstance(returned, bool | np.bool_):
        raise MessageError(f"it is {_kind(returned)}, expected True or False")
    return bool(returned)


def plain_belief(returned: object, index: int, neighbours: Collection[str]) -> Belief:
    """Check and convert the return value of ``Estimator.belief`` after the block ``index``.

    Raises:
        MessageError: Other robots could not use it; the text says what to do.
    """
    if not isinstance(returned, Belief):
        raise MessageError(f"it is {_kind(returned)}, expected a Belief, see agents/estimator.py")
    check_choice("phase", returned.phase, ("poses", "inertia"))
    if not isinstance(returned.converged, bool | np.bool_):
        raise MessageError(f"converged is {_kind(returned.converged)}, expected True or False")
    total_wrench = plain_array(returned.total_wrench, "total_wrench")
    check_numbers(total_wrench, (6,), "total_wrench")
    return Belief(
        phase=returned.phase,
        converged=bool(returned.converged),
        payload=None if returned.payload is None else _plain_payload(returned.payload),
        poses=_plain_poses(returned.poses, neighbours),
        total_block=_block(returned.total_block, index, "total_block"),
        total_wrench=total_wrench,
        not_observable=plain_texts(returned.not_observable, "not_observable"),
        load_changes=_plain_items(returned.load_changes, LoadChangeNotice, "load_changes"),
        learned_block=_block(returned.learned_block, index, "learned_block"),
        grasps=returned.grasps,
        sensor_errors=_plain_items(returned.sensor_errors, SensorErrorEstimate, "sensor_errors"),
        slips=_plain_items(returned.slips, SlipNotice, "slips"),
        shortfall=plain_texts(returned.shortfall, "shortfall"),
    )


def plain_array(value: object, place: str) -> Array:
    """Return a copy as float64 in row-major order, or raise a ``MessageError`` if it is no array of real numbers.

    Sums over other layouts may differ in the last digit.
    """
    if not isinstance(value, np.ndarray):
        raise MessageError(f"{place} is {_kind(value)}, expected an array: np.array(…) makes one")
    if value.dtype.kind not in "fiub":
        raise MessageError(f"{place} is an array of {value.dtype}, expected one of real numbers")
    return np.array(value, dtype=np.float64, order="C")


def _plain_payload(payload: object) -> PayloadEstimate:
    if not isinstance(payload, PayloadEstimate):
        raise MessageError(f"payload is {_kind(payload)}, expected a PayloadEstimate or None")
    plain = PayloadEstimate(
        mass=_number(payload.mass, "mass"),
        com=None if payload.com is None else plain_array(payload.com, "com"),
        tensor=None if payload.tensor is None else plain_array(payload.tensor, "tensor"),
        covariance=plain_array(payload.covariance, "covariance of payload"),
    )
    check_payload(plain)
    return plain


def _plain_poses(poses: object, neighbours: Collection[str]) -> dict[str, UncertainPose]:
    if not isinstance(poses, Mapping):
        raise MessageError(f"poses are {_kind(poses)}, expected a dict by neighbours' names")
    plain = {}
    for name, pose in poses.items():
        if name not in neighbours:
            raise MessageError(f"poses contain {name!r}, expected neighbours only: {', '.join(neighbours)}")
        if not isinstance(pose, UncertainPose) or not isinstance(pose.pose, Pose):
            raise MessageError(f"pose of {name!r} is {_kind(pose)}, expected an UncertainPose of a Pose")
        rotation = plain_array(pose.pose.rotation, f"rotation of {name!r}")
        translation = plain_array(pose.pose.translation, f"translation of {name!r}")
        covariance = plain_array(pose.covariance, f"covariance of pose of {name!r}")
        check_pose(PoseEstimate(rotation, translation, covariance), name)
        plain[name] = UncertainPose(Pose(rotation, translation), covariance)
    return plain


def _plain_items(items: object, kind: type[S], place: str) -> tuple[S, ...]:
    plain = []
    for item in _sequence(items, place):
        if not isinstance(item, kind):
            raise MessageError(f"{place} contains {_kind(item)}, expected a {kind.__name__} each")
        values: dict[str, Any] = {}
        for field in msgspec.structs.fields(kind):
            value = getattr(item, field.name)
            if field.type is str:
                [values[field.name]] = plain_texts((value,), field.name)
            else:
                values[field.name] = _number(value, field.name)
                check_number(values[field.name], field.name)
        plain.append(kind(**values))
    return tuple(plain)


def plain_texts(texts: object, place: str = "it") -> tuple[str, ...]:
    """Convert texts, such as those of ``Estimator.doubts``, without line breaks, or raise a ``MessageError``."""
    found = _sequence(texts, place)
    for text in found:
        if not isinstance(text, str):
            raise MessageError(f"{place} contains {_kind(text)}, expected texts")
    return tuple(map(one_line, found))


def _sequence(value: object, place: str) -> tuple[Any, ...]:
    """Return the items of a tuple or list; a single text is refused, though it is a sequence of letters."""
    if not isinstance(value, tuple | list):
        raise MessageError(f"{place} is {_kind(value)}, expected a tuple, such as (one,), or () if there is none")
    return tuple(value)


def _number(value: Any, place: str) -> float:
    return _converted(float, value, place, "a number")


def _block(value: Any, index: int, place: str) -> int:
    block = _converted(operator.index, value, place, "the number of a block")
    if not -1 <= block <= index:
        raise MessageError(f"{place} is {block}, expected -1 for none, or at most {index}, the block of the last step")
    return block


def _converted(convert: Callable[[Any], T], value: object, place: str, expected: str) -> T:
    if isinstance(value, str):
        raise MessageError(f"{place} is the text {value!r}, expected {expected}")
    try:
        return convert(value)
    except (TypeError, ValueError) as error:
        raise MessageError(f"{place} is {_kind(value)}, expected {expected}") from error


def _kind(value: object) -> str:
    """Describe a value by its type, and an array also by its shape."""
    if value is None:
        return "None"
    shape = f" of the shape {value.shape}" if isinstance(value, np.ndarray) else ""
    return f"a {type(value).__name__}{shape}"


def _kilobytes(size: int) -> str:
    return f"{size / 1e3:.1f} kB"
