"""Conversion of messages to bytes and back.

All messages leave a process through ``encode`` and enter one through ``Reader``, which raises ``MessageError`` for
anything but a valid message of the expected kind. The checksum includes the key under which the message is sent, and a
key begins with the name of the run. So a message that is damaged, or comes from an older run, another process or
another topic, is refused even if it could be decoded. The checksum is not a signature; the secure profile uses TLS for
that.
"""

import math
import typing
from collections.abc import Collection
from functools import cache, lru_cache
from typing import Any, Generic, TypeVar, cast

import numpy as np

from coheft.errors import MessageError
from coheft.estimation.geometry.spatial import Array
from coheft.wire.messages.frame import Seal
from coheft.wire.messages.kind import MALFORMED, Kind
from coheft.wire.messages.structs import Message

M = TypeVar("M")


@cache
def _kind(kind: type[Message]) -> Kind:
    return Kind(kind)


class Reader(Generic[M]):
    """Decodes the messages of a kind, or of a union of kinds, that are received under one key."""

    def __init__(self, kind: type[M], key: str) -> None:
        self._name = getattr(kind, "__name__", str(kind))
        self._kinds = {each.code: _kind(each) for each in typing.get_args(kind) or (kind,)}
        self._seal = Seal(key)

    def read(self, data: bytes) -> M:
        """Decode a message.

        Raises:
            MessageError: The bytes are damaged, were sent under another key (for instance in another run), are another
                message, or have another protocol version.
        """
        frame = self._seal.unwrapped(data, self._name)
        kind = self._kinds.get(frame.code)
        if kind is None:
            names = {each.code: each.__name__ for each in Message.__subclasses__()}
            found = names.get(frame.code, f"message of kind {frame.code}")
            raise MessageError(f"not a {self._name}: it is a {found}")
        try:
            return cast(M, kind.decode(frame))
        except MALFORMED as error:
            raise MessageError(f"not a {self._name}: {error}") from error


_seal = lru_cache(maxsize=1024)(Seal)
_reader: Any = lru_cache(maxsize=256)(Reader)


def encode(message: Message, key: str) -> bytes:
    """Return the message as bytes, to be sent under ``key``."""
    return _kind(type(message)).encode(message, _seal(key))


def decode(data: bytes, kind: type[M], key: str) -> M:
    """Decode a message that was received under ``key``, see ``Reader``.

    Raises:
        MessageError: The bytes are not a message of that kind.
    """
    message: M = _reader(kind, key).read(data)
    return message


def is_finite(array: Array) -> bool:
    """Whether all numbers of an array are finite."""
    # Nearly always the sum of squares is finite: one pass instead of three. It may overflow for finite numbers.
    return math.isfinite(np.vdot(array, array)) or bool(np.isfinite(array).all())


def check_array(array: Array, shape: tuple[int, ...], name: str) -> None:
    """Check that a received array has a shape and is finite; raise ``MessageError`` if not."""
    if array.shape != shape:
        raise MessageError(f"{name}.shape is {array.shape} but expected {shape}")
    if not is_finite(array):
        count = int(np.size(array) - np.isfinite(array).sum())
        raise MessageError(f"{name} contains {count} numbers that are not finite")


def check_field(name: str, found: object, expected: object) -> None:
    """Check a field of a received message; raise ``MessageError`` if it is not as expected."""
    if found != expected:
        raise MessageError(f"{name} is {found!r} but expected {expected!r}")


def check_choice(name: str, found: object, choices: Collection[object]) -> None:
    """Check that a received field is one of the allowed values; raise ``MessageError`` if not."""
    if found not in choices:
        raise MessageError(f"{name} is {found!r} but expected one of {', '.join(map(repr, choices))}")
