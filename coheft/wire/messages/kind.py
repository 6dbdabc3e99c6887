"""Encoding and decoding of the messages of one kind, without the header.

In kinds that are sent in every block, the fields other than arrays hardly ever change: they are encoded, decoded and
validated once, and then looked up.
"""

from __future__ import annotations

import struct
import typing
from typing import Any, NamedTuple, cast

import msgspec
import numpy as np

from coheft.wire.messages.array_block import CODES, DOUBLE, AnyArray, described, known_places, places_of
from coheft.wire.messages.frame import HEADER, Frame, Seal, padded
from coheft.wire.messages.structs import Message

MALFORMED = (msgspec.DecodeError, ValueError, struct.error, RecursionError)
"""Exceptions that decoding raises for invalid bytes; ``RecursionError`` for excessive nesting."""
_NEXT_ARRAY = msgspec.msgpack.Ext(1, b"")
"""Placeholder of an array among the fields: the first one stands for the first array, and so on."""
_KNOWN = 256
"""Largest number of fields of a kind that are kept: enough for the records of all robots that neighbours forward."""
_LONGEST_KNOWN = 2**13
"""Longer fields are not kept [B]."""


class _Known(NamedTuple):
    """Fields that were decoded before.

    Attributes:
        constants: The fields that are not arrays.
        names: For each array the field, and if the field is a dictionary of arrays, the key.
    """

    constants: dict[str, Any]
    names: list[tuple[str, str | None]]


class Kind:
    """Encodes and decodes messages of one kind.

    Attributes:
        kind: The type of the messages.
    """

    def __init__(self, kind: type[Message]) -> None:
        self.kind = kind
        self._block, self._number = kind.in_header
        found = [field for field in msgspec.structs.fields(kind) if field.name not in kind.in_header]
        self._names = [field.name for field in found]
        self._tables = [each.name for each in found if typing.get_origin(each.type) is dict]
        self._arrays = [each.name for each in found if typing.get_origin(each.type) is np.ndarray]
        self._constants = [name for name in self._names if name not in (*self._tables, *self._arrays)]
        field = cast(Any, msgspec.field)
        self._fields = msgspec.defstruct(
            kind.__name__,
            [
                (each.name, each.type, field(default=each.default, default_factory=each.default_factory))
                for each in found
            ],
            forbid_unknown_fields=True,
            kw_only=True,
        )
        self._known: dict[bytes, _Known] = {}
        self._written: dict[object, bytes] = {}

    # --- to bytes ---

    def encode(self, message: Message, seal: Seal) -> bytes:
        """Return a message as bytes."""
        block = getattr(message, self._block) if self._block else 0
        number = getattr(message, self._number) if self._number else 0
        arrays: list[AnyArray] = []
        if self.kind.is_steady:
            fields = self._known_fields(message, arrays)
        else:
            fields = self._encoded(message, arrays)
        for place, array in enumerate(arrays):
            if array.dtype not in CODES:
                arrays[place] = array.astype(DOUBLE)
        shapes = described(tuple([(array.dtype, array.shape) for array in arrays])) if arrays else b""
        return seal.wrapped(self.kind.code, block, number, fields, shapes, arrays)

    def _known_fields(self, message: Message, arrays: list[AnyArray]) -> bytes:
        """Return the same as ``_encoded``, for a kind whose arrays are fields, or values of dictionaries."""
        key: list[object] = []
        for name in self._constants:
            value = getattr(message, name)
            key.append(tuple(value) if isinstance(value, list) else value)
        for name in self._arrays:
            arrays.append(getattr(message, name))
        for name in self._tables:
            table = getattr(message, name)
            key += table
            arrays += table.values()
        try:
            fields = self._written.get(tuple(key))
        except TypeError:  # not hashable, for instance a list within a list
            return self._encoded(message, [])
        if fields is None:
            fields = self._encoded(message, [])
            if len(fields) <= _LONGEST_KNOWN:
                if len(self._written) >= _KNOWN:
                    self._written.clear()
                self._written[tuple(key)] = fields
        return fields

    def _encoded(self, message: Message, arrays: list[AnyArray]) -> bytes:
        """Return the encoded fields of a message, and append its arrays to ``arrays``."""

        def next_array(value: Any) -> msgspec.msgpack.Ext:
            if not isinstance(value, np.ndarray):
                raise NotImplementedError(f"cannot send a {type(value).__name__}")
            arrays.append(value)
            return _NEXT_ARRAY

        # Arrays come last: first those that are fields, then dictionaries, in the order of ``_known_fields``.
        names = (*self._constants, *self._arrays, *self._tables)
        return msgspec.msgpack.Encoder(enc_hook=next_array).encode({name: getattr(message, name) for name in names})

    # --- from bytes ---

    def of_known_fields(self, data: bytes, first: int, end: int, block: int, number: int) -> Message | None:
        """Return the message if its fields, which end at ``first``, were decoded before, else None.

        Args:
            data: Bytes with a valid checksum.
            first: End of the fields and start of the shapes [B].
            end: End of the shapes [B].
            block: ``block`` in the header.
            number: ``number`` in the header.
        """
        known = self._known.get(data[HEADER.size : first])
        if known is None:
            return None
        places = known_places(data[first:end])
        arrays = bytearray(memoryview(data)[padded(end) :])
        if len(places.each) != len(known.names) or places.size != len(arrays):
            return None
        values = known.constants.copy()
        for name in self._tables:
            values[name] = {}
        for (name, inner), (dtype, shape, begin) in zip(known.names, places.each, strict=True):
            array: AnyArray = np.ndarray(shape, dtype, arrays, begin)
            if inner is None:
                values[name] = array
            else:
                values[name][inner] = array
        return self._with_header(values, block, number)

    def decode(self, frame: Frame) -> Message:
        """Decode a frame of this kind, and keep its fields if the kind is steady.

        Raises:
            ValueError, msgspec.DecodeError, struct.error, RecursionError: The frame is invalid.
        """
        places = places_of(frame.shapes)
        if places.size != len(frame.arrays):
            raise ValueError(f"its arrays take {places.size} bytes but there are {len(frame.arrays)}")
        # A copy of all arrays, so that none keeps the message alive and all are aligned like other arrays: sums over
        # unaligned
        # arrays may differ in the last digit.
        data = bytearray(frame.arrays)
        arrays: list[AnyArray] = [np.ndarray(shape, dtype, data, begin) for dtype, shape, begin in places.each]
        left = iter(arrays)

        def next_array(code: int, header: memoryview) -> AnyArray:
            if code != _NEXT_ARRAY.code or len(header):
                raise ValueError(f"extension {code} of {len(header)} bytes is not an array: expected 1 of 0 bytes")
            array = next(left, None)
            if array is None:
                raise ValueError(f"it names more than its {len(arrays)} arrays")
            return array

        fields = msgspec.msgpack.Decoder(self._fields, ext_hook=next_array).decode(frame.fields)
        if next(left, None) is not None:
            raise ValueError(f"it names fewer than its {len(arrays)} arrays")
        values = {name: getattr(fields, name) for name in self._names}
        if self.kind.is_steady and len(frame.fields) <= _LONGEST_KNOWN:
            if len(self._known) >= _KNOWN:
                self._known.clear()
            self._known[frame.fields] = self._to_known(values, arrays)
        return self._with_header(values, frame.block, frame.number)

    def _to_known(self, values: dict[str, Any], arrays: list[AnyArray]) -> _Known:
        """Return the fields in the form that is kept, with the order in which they name arrays.

        Raises:
            ValueError: Two arrays have the same name.
        """
        names: dict[int, tuple[str, str | None]] = {id(values[name]): (name, None) for name in self._arrays}
        for table in self._tables:
            names |= {id(array): (table, name) for name, array in values[table].items()}
        if len(names) != len(arrays):
            raise ValueError(f"it has {len(arrays)} arrays but {len(names)} names for them")
        constants = {name: values[name] for name in self._constants}
        return _Known(constants, [names[id(array)] for array in arrays])

    def _with_header(self, values: dict[str, Any], block: int, number: int) -> Message:
        """Return the message with these fields and those from the header.

        Raises:
            ValueError: The header has a number for which this kind has no field.
        """
        for name, value in ((self._block, block), (self._number, number)):
            if name is not None:
                values[name] = value
            elif value:
                raise ValueError(f"its header has {value} for a field that this kind does not have")
        return self.kind(**values)
