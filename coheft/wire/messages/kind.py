"""How the messages of one kind become bytes and are found in bytes, behind their header.

Of kinds that come block after block the fields, arrays aside, hardly ever change: they are encoded, decoded and
validated once, and then known.
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
"""What decoding raises for bytes that are no message; the last for absurdly deep nesting."""
_NEXT_ARRAY = msgspec.msgpack.Ext(1, b"")
"""What stands for an array among the fields: the first one stands for the first array, and so on."""
_KNOWN = 256
"""Fields of a kind that are known at most: all that neighbours hand on, one robot's line after the other."""
_LONGEST_KNOWN = 2**13
"""Longer ones are not kept [B]."""


class _Known(NamedTuple):
    """Fields that have come before.

    Attributes:
        constants: Those that are no arrays.
        names: Of each array the field, and if that is a table of some, its name there.
    """

    constants: dict[str, Any]
    names: list[tuple[str, str | None]]


class Kind:
    """How messages of one kind travel.

    Attributes:
        kind: It.
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
        """A message as bytes."""
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
        """The same as ``_encoded``, of a message of a steady kind: arrays are fields, or in tables."""
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
        except TypeError:  # a list within a list, say: nothing that can be looked up
            return self._encoded(message, [])
        if fields is None:
            fields = self._encoded(message, [])
            if len(fields) <= _LONGEST_KNOWN:
                if len(self._written) >= _KNOWN:
                    self._written.clear()
                self._written[tuple(key)] = fields
        return fields

    def _encoded(self, message: Message, arrays: list[AnyArray]) -> bytes:
        """The fields of a message; appends the arrays in them."""

        def next_array(value: Any) -> msgspec.msgpack.Ext:
            if not isinstance(value, np.ndarray):
                raise NotImplementedError(f"cannot send a {type(value).__name__}")
            arrays.append(value)
            return _NEXT_ARRAY

        # Arrays come last, first those that are fields, then tables, as ``_known_fields`` has them.
        names = (*self._constants, *self._arrays, *self._tables)
        return msgspec.msgpack.Encoder(enc_hook=next_array).encode({name: getattr(message, name) for name in names})

    # --- from bytes ---

    def of_known_fields(self, data: bytes, first: int, end: int, block: int, number: int) -> Message | None:
        """The message in bytes that are sound; None if its fields, which end at ``first``, are not known.

        Args:
            data: It.
            first: Where the fields end, and shapes begin [B].
            end: Where shapes end [B].
            block: In the header.
            number: The same.
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
        """The message in a frame of this kind; its fields are known from now on if they are of those that come again.

        Raises:
            ValueError, msgspec.DecodeError, struct.error, RecursionError: It is none.
        """
        places = places_of(frame.shapes)
        if places.size != len(frame.arrays):
            raise ValueError(f"its arrays take {places.size} bytes but there are {len(frame.arrays)}")
        # A copy of them all, so that none keeps the message alive, and all begin where an array of our own would: sums
        # over arrays that begin at odd addresses may differ in their last digit.
        data = bytearray(frame.arrays)
        arrays: list[AnyArray] = [np.ndarray(shape, dtype, data, begin) for dtype, shape, begin in places.each]
        left = iter(arrays)

        def next_array(code: int, header: memoryview) -> AnyArray:
            if code != _NEXT_ARRAY.code or len(header):
                raise ValueError(f"extension {code} of {len(header)} bytes is not an array: expected 1 of none")
            array = next(left, None)
            if array is None:
                raise ValueError(f"it names more than the {len(arrays)} arrays that there are")
            return array

        fields = msgspec.msgpack.Decoder(self._fields, ext_hook=next_array).decode(frame.fields)
        if next(left, None) is not None:
            raise ValueError(f"it names fewer than the {len(arrays)} arrays that there are")
        values = {name: getattr(fields, name) for name in self._names}
        if self.kind.is_steady and len(frame.fields) <= _LONGEST_KNOWN:
            if len(self._known) >= _KNOWN:
                self._known.clear()
            self._known[frame.fields] = self._what_is_known(values, arrays)
        return self._with_header(values, frame.block, frame.number)

    def _what_is_known(self, values: dict[str, Any], arrays: list[AnyArray]) -> _Known:
        """What there is to know of fields, and of the order in which they name arrays.

        Raises:
            ValueError: An array has no name, because two had the same.
        """
        names: dict[int, tuple[str, str | None]] = {id(values[name]): (name, None) for name in self._arrays}
        for table in self._tables:
            names |= {id(array): (table, name) for name, array in values[table].items()}
        if len(names) != len(arrays):
            raise ValueError(f"it has {len(arrays)} arrays but {len(names)} names of them")
        constants = {name: values[name] for name in self._constants}
        return _Known(constants, [names[id(array)] for array in arrays])

    def _with_header(self, values: dict[str, Any], block: int, number: int) -> Message:
        """The message with these fields, and those from the header.

        Raises:
            ValueError: There is something in the header for which this kind has no field.
        """
        for name, value in ((self._block, block), (self._number, number)):
            if name is not None:
                values[name] = value
            elif value:
                raise ValueError(f"its header has {value} where this kind has nothing")
        return self.kind(**values)
