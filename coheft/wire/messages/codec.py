"""Conversion of messages to bytes and back.

All messages leave a process through ``Writer`` and enter one through ``Reader``, which raises ``MessageError`` for
anything but a valid message of the expected kind. The checksum includes the key under which the message is sent, and a
key begins with the name of the run. So a message that is damaged, or comes from an older run, another process or
another topic, is refused even if it could be decoded. The checksum is not a signature; the secure profile uses TLS for
that.
"""

import math
import typing
import zlib
from collections.abc import Collection
from functools import cache, lru_cache
from typing import Any, Generic, TypeVar, cast

import numpy as np

from coheft.errors import MessageError
from coheft.estimation.geometry.spatial import Array
from coheft.wire.messages.frame import CHECKSUM, HEADER, PROTOCOL_VERSION, WORD, Seal
from coheft.wire.messages.kind import MALFORMED, Kind
from coheft.wire.messages.structs import Message

M = TypeVar("M")


@cache
def _kind(kind: type[Message]) -> Kind:
    return Kind(kind)


class Writer:
    """Encodes the messages that are sent under one key."""

    def __init__(self, key: str) -> None:
        self._seal = Seal(key)

    def write(self, message: Message) -> bytes:
        """Return the message as bytes."""
        return _kind(type(message)).encode(message, self._seal)


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
        message = self._of_known_start(data)
        return cast(M, self._in_words(data) if message is None else message)

    def _of_known_start(self, data: bytes) -> Message | None:
        """Decode a message whose fields and shapes are known from an earlier one; None otherwise, or if invalid."""
        if len(data) < HEADER.size:
            return None
        checksum, version, code, words, run, size, block, number = HEADER.unpack_from(data)
        kind = self._kinds.get(code)
        if kind is None or version != PROTOCOL_VERSION or run != self._seal.run:
            return None
        if zlib.crc32(memoryview(data)[CHECKSUM.size :], self._seal.seed) != checksum:
            return None
        first = HEADER.size + size
        return kind.of_known_start(data, first, first + words * WORD, block, number)

    def _in_words(self, data: bytes) -> Message:
        """Decode a message step by step, with an error that names the problem."""
        frame = self._seal.unwrapped(data, self._name)
        kind = self._kinds.get(frame.code)
        if kind is None:
            names = {each.code: each.__name__ for each in Message.__subclasses__()}
            found = names.get(frame.code, f"message of kind {frame.code}")
            raise MessageError(f"not a {self._name}: it is a {found}")
        try:
            return kind.decode(frame)
        except MALFORMED as error:
            raise MessageError(f"not a {self._name}: {error}") from error


_writer = lru_cache(maxsize=256)(Writer)
_reader: Any = lru_cache(maxsize=256)(Reader)


def encode(message: Message, key: str) -> bytes:
    """Return the message as bytes, to be sent under ``key``, see ``Writer``."""
    return _writer(key).write(message)


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
