"""Encoding and decoding of the messages of one kind, without the header."""

import struct
import typing
from collections.abc import Iterator
from threading import Lock
from typing import Any, cast

import msgspec
import numpy as np

from coheft.wire.messages.frame import CODES, DOUBLE, AnyArray, Frame, KeyChecksum, described, places_of
from coheft.wire.messages.structs import Message

MALFORMED = (msgspec.DecodeError, ValueError, struct.error, RecursionError)
"""Exceptions that decoding raises for invalid bytes; ``RecursionError`` for excessive nesting."""
_NEXT_ARRAY = msgspec.msgpack.Ext(1, b"")
"""Placeholder of an array among the fields: the first one stands for the first array, and so on."""


class Kind:
    """Encodes and decodes messages of one kind, in any thread."""

    def __init__(self, kind: type[Message]) -> None:
        self.kind = kind
        found = [each for each in msgspec.structs.fields(kind) if each.name not in kind.in_header]
        self._names = [each.name for each in sorted(found, key=_place)]
        field = cast(Any, msgspec.field)
        fields = msgspec.defstruct(
            kind.__name__,
            [
                (each.name, each.type, field(default=each.default, default_factory=each.default_factory))
                for each in found
            ],
            forbid_unknown_fields=True,
            kw_only=True,
        )
        # Made once, because msgspec analyses types for it; one message at a time, as hooks get no argument of ours.
        self._encoder = msgspec.msgpack.Encoder(enc_hook=self._placeholder)
        self._decoder = msgspec.msgpack.Decoder(fields, ext_hook=self._next_array)
        self._sent: list[AnyArray] = []
        self._received: Iterator[AnyArray] = iter(())
        self._lock = Lock()

    def encode(self, message: Message, checksum: KeyChecksum) -> bytes:
        """Return a message as bytes; arrays of other types than ``DTYPES`` are converted to double precision."""
        of_block, of_number = self.kind.in_header
        block = 0 if of_block is None else getattr(message, of_block)
        number = 0 if of_number is None else getattr(message, of_number)
        with self._lock:
            self._sent = []
            fields = self._encoder.encode({name: getattr(message, name) for name in self._names})
            arrays = [each if each.dtype in CODES else each.astype(DOUBLE) for each in self._sent]
        return checksum.wrapped(self.kind.code, block, number, fields, described(arrays), arrays)

    def _placeholder(self, value: Any) -> msgspec.msgpack.Ext:
        if not isinstance(value, np.ndarray):
            raise NotImplementedError(f"cannot send a {type(value).__name__}")
        self._sent.append(value)
        return _NEXT_ARRAY

    def decode(self, frame: Frame) -> Any:
        """Decode a frame of this kind; an invalid one raises one of ``MALFORMED``."""
        places, size = places_of(frame.shapes)
        if size != len(frame.arrays):
            raise ValueError(f"its arrays take {size} bytes but there are {len(frame.arrays)}")
        # A copy of all arrays, so that none keeps the message alive and all are aligned like other arrays: sums
        # over unaligned arrays may differ in the last digit.
        data = bytearray(frame.arrays)
        arrays: list[AnyArray] = [np.ndarray(shape, dtype, data, begin) for dtype, shape, begin in places]
        with self._lock:
            self._received = iter(arrays)
            fields = self._decoder.decode(frame.fields)
            if next(self._received, None) is not None:
                raise ValueError(f"it names fewer than its {len(arrays)} arrays")
        values = msgspec.structs.asdict(fields)
        for name, value in zip(self.kind.in_header, (frame.block, frame.number), strict=True):
            if name is not None:
                values[name] = value
            elif value:
                raise ValueError(f"its header has {value} for a field that this kind does not have")
        return self.kind(**values)

    def _next_array(self, code: int, header: memoryview) -> AnyArray:
        if code != _NEXT_ARRAY.code or len(header):
            raise ValueError(f"extension {code} of {len(header)} bytes is not an array: expected 1 of 0 bytes")
        array = next(self._received, None)
        if array is None:
            raise ValueError("it names more arrays than it has")
        return array


def _place(field: msgspec.structs.FieldInfo) -> int:
    """Return a number that grows with the place of a field in a message: arrays come last, then tables of them."""
    return {np.ndarray: 1, dict: 2}.get(typing.get_origin(field.type), 0)
