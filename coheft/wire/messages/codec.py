"""Conversion of messages to bytes and back.

All messages leave a process through ``encode`` and enter one through ``decode``, which raises ``MessageError`` for
anything but a valid message of the expected kind. The checksum includes the key under which the message is sent, and a
key begins with the name of the run. So a message that is damaged, or comes from an older run, another process or
another topic, is refused even if it could be decoded. The checksum is not a signature; the secure profile uses TLS for
that.
"""

import math
import typing
from collections.abc import Collection
from functools import cache, lru_cache
from typing import Any, TypeVar

import numpy as np

from coheft.errors import MessageError
from coheft.estimation.geometry.spatial import Array
from coheft.wire.messages.frame import DOUBLE, KeyChecksum
from coheft.wire.messages.kind import MALFORMED, Kind
from coheft.wire.messages.structs import Message

M = TypeVar("M")
_LARGEST = 1e15
"""Limit of received numbers."""
_kind = cache(Kind)
_checksum = lru_cache(maxsize=1024)(KeyChecksum)


@cache
def _expected(kind: Any) -> tuple[str, dict[int, Kind]]:
    """Return the name of a kind, or those of a union of kinds, and all kinds by their codes."""
    kinds = typing.get_args(kind) or (kind,)
    return " or ".join(each.__name__ for each in kinds), {each.code: _kind(each) for each in kinds}


def encode(message: Message, key: str) -> bytes:
    """Return the message as bytes, to be sent under ``key``."""
    return _kind(type(message)).encode(message, _checksum(key))


def decode(data: bytes, kind: type[M], key: str) -> M:
    """Decode a message of a kind, or of a union of kinds, that was received under ``key``.

    Bytes that are damaged, were sent under another key (for instance in another run), are another message, or have
    another protocol version raise a ``MessageError``.
    """
    name, kinds = _expected(kind)  # type: ignore[arg-type]
    frame = _checksum(key).unwrapped(data, name)
    if frame.code not in kinds:
        names = {each.code: each.__name__ for each in Message.__subclasses__()}
        raise MessageError(f"not a {name}: it is a {names.get(frame.code, f'message of kind {frame.code}')}")
    try:
        message: M = kinds[frame.code].decode(frame)
    except MALFORMED as error:
        raise MessageError(f"not a {name}: {error}") from error
    return message


def is_finite(array: Array) -> bool:
    """Whether all numbers of an array are finite."""
    # Nearly always the sum of squares is finite: one pass instead of three. It may overflow for finite numbers.
    return math.isfinite(np.vdot(array, array)) or bool(np.isfinite(array).all())


def check_numbers(array: Array, shape: tuple[int, ...], name: str) -> None:
    """Check shape and numbers of a received array in double precision; ``MessageError`` if it cannot be used."""
    if array.shape != shape or array.dtype != DOUBLE:  # products of whole numbers may overflow
        check_field(f"{name}.shape", array.shape, shape)
        check_field(f"{name}.dtype", array.dtype.name, DOUBLE.name)
    # Nearly always the sum of squares shows it; it is not below the limit for numbers that are not finite.
    if np.vdot(array, array) < _LARGEST**2:
        return
    if count := np.count_nonzero(~np.isfinite(array)):
        raise MessageError(f"{name} contains {count} numbers that are not finite")
    check_number(float(np.abs(array).max()), f"largest number of {name}")


def check_number(value: float, name: str) -> None:
    """Check that a received number is finite and not too large; raise ``MessageError`` if not."""
    if not (math.isfinite(value) and abs(value) < _LARGEST):
        raise MessageError(f"{name} is {value} but expected less than {_LARGEST:g}")


def check_field(name: str, found: object, expected: object) -> None:
    """Check a field of a received message; raise ``MessageError`` if it is not as expected."""
    if found != expected:
        raise MessageError(f"{name} is {found!r} but expected {expected!r}")


def check_choice(name: str, found: object, choices: Collection[object]) -> None:
    """Check that a received field is one of the allowed values; raise ``MessageError`` if not."""
    if found not in choices:
        raise MessageError(f"{name} is {found!r} but expected one of {', '.join(map(repr, choices))}")
