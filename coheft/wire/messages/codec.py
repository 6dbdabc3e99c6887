"""Messages to bytes and back.

``Writer`` and ``Reader`` are the only way out of a process and into one; a reader raises ``MessageError`` for anything
that is not exactly the message that was expected. The checksum covers the key under which the message is said, too, and
a key begins with the name of the run: what was damaged on its way, or said in an older run, by another process or under
another topic, is refused even where it would still be a message. It is no signature: that is what TLS is for.
"""

from __future__ import annotations

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
    """Makes bytes of messages that are said under one key."""

    def __init__(self, key: str) -> None:
        self._seal = Seal(key)

    def write(self, message: Message) -> bytes:
        """The message as bytes."""
        return _kind(type(message)).encode(message, self._seal)


class Reader(Generic[M]):
    """Finds the messages in what comes under one key.

    Args:
        kind: What is expected: a message, or a union of some.
        key: The key.
    """

    def __init__(self, kind: type[M], key: str) -> None:
        self._name = getattr(kind, "__name__", str(kind))
        self._kinds = {each.code: _kind(each) for each in typing.get_args(kind) or (kind,)}
        self._seal = Seal(key)

    def read(self, data: bytes) -> M:
        """The message in ``data``.

        Raises:
            MessageError: The bytes are damaged or were said under another key, for instance in another run; or they
                are no such message, or one of another protocol version.
        """
        message = self._of_known_fields(data)
        return cast(M, self._in_words(data) if message is None else message)

    def _of_known_fields(self, data: bytes) -> Message | None:
        """The message if it is sound and its fields are known: all is checked, but nothing said."""
        if len(data) < HEADER.size:
            return None
        checksum, version, code, words, run, size, block, number = HEADER.unpack_from(data)
        kind = self._kinds.get(code)
        if kind is None or version != PROTOCOL_VERSION or run != self._seal.run:
            return None
        if zlib.crc32(memoryview(data)[CHECKSUM.size :], self._seal.seed) != checksum:
            return None
        first = HEADER.size + size
        try:
            return kind.of_known_fields(data, first, first + words * WORD, block, number)
        except MALFORMED:
            return None

    def _in_words(self, data: bytes) -> Message:
        """The same as ``read``, step by step."""
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
    """The message as bytes, to be said under ``key``, see ``Writer``."""
    return _writer(key).write(message)


def decode(data: bytes, kind: type[M], key: str) -> M:
    """The message in ``data``, which came under ``key``, see ``Reader``.

    Raises:
        MessageError: It is none of that kind.
    """
    message: M = _reader(kind, key).read(data)
    return message


def is_finite(array: Array) -> bool:
    """Whether all numbers of an array are."""
    # The sum of squares is so nearly always: one pass instead of three. It may overflow though no number has.
    return math.isfinite(np.vdot(array, array)) or bool(np.isfinite(array).all())


def check_array(array: Array, shape: tuple[int, ...], name: str) -> None:
    """Check an array that came over the wire.

    Raises:
        MessageError: Its shape is not ``shape``, or a number in it is not finite.
    """
    if array.shape != shape:
        raise MessageError(f"{name}.shape is {array.shape} but expected {shape}")
    if not is_finite(array):
        count = int(np.size(array) - np.isfinite(array).sum())
        raise MessageError(f"{name} holds {count} numbers that are not finite")


def check_field(name: str, found: object, expected: object) -> None:
    """Check a field of a message that came over the wire.

    Raises:
        MessageError: It is not what is expected here.
    """
    if found != expected:
        raise MessageError(f"{name} is {found!r} but expected {expected!r}")


def check_choice(name: str, found: object, choices: Collection[object]) -> None:
    """Check that a field of a message that came over the wire is one of those that it can be.

    Raises:
        MessageError: It is another.
    """
    if found not in choices:
        raise MessageError(f"{name} is {found!r} but expected one of {', '.join(map(repr, choices))}")
