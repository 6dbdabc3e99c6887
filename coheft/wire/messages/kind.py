"""Encoding and decoding of the messages of one kind, without the header.

In kinds that are sent in every block, the fields other than arrays and the arrays' shapes hardly ever change: they are
encoded, decoded and validated once, and then looked up.
"""

import struct
import typing
from typing import Any, NamedTuple, cast

import msgspec
import numpy as np

from coheft.wire.messages.array_block import CODES, DOUBLE, AnyArray, Places, described, known_places
from coheft.wire.messages.frame import HEADER, Frame, Seal, Start, padded
from coheft.wire.messages.structs import Message

MALFORMED = (msgspec.DecodeError, ValueError, struct.error, RecursionError)
"""Exceptions that decoding raises for invalid bytes; ``RecursionError`` for excessive nesting."""
_NEXT_ARRAY = msgspec.msgpack.Ext(1, b"")
"""Placeholder of an array among the fields: the first one stands for the first array, and so on."""
_KNOWN = 2**13
"""Largest number of starts of a kind that are kept: 48 agents in one process forward all records of each other."""
_LONGEST_KNOWN = 2**11
"""Longer starts are not kept [B]."""


class _Known(NamedTuple):
    """The start of messages that was decoded before.

    Attributes:
        first: End of the fields [B].
        begin: Offset of the first array [B].
        end: Size of the message [B].
        constants: The fields that are not arrays.
        arrays: For each array the field, the key if the field is a dictionary of arrays, type, shape, and offset from
            the first one [B].
    """

    first: int
    begin: int
    end: int
    constants: dict[str, Any]
    arrays: list[tuple[str, str | None, np.dtype[Any], tuple[int, ...], int]]


class Kind:
    """Encodes and decodes messages of one kind."""

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
        self._written: dict[object, Start] = {}

    # --- to bytes ---

    def encode(self, message: Message, seal: Seal) -> bytes:
        """Return a message as bytes."""
        block = getattr(message, self._block) if self._block else 0
        number = getattr(message, self._number) if self._number else 0
        arrays: list[AnyArray] = []
        if self.kind.is_steady:
            start = self._known_start(message, arrays)
        else:
            start = self._start(self._encoded(message, arrays), arrays)
        return seal.wrapped(self.kind.code, block, number, start, arrays)

    def _known_start(self, message: Message, arrays: list[AnyArray]) -> Start:
        """Append a message's arrays, which are fields or values of dictionaries, and return its start."""
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
        for array in arrays:
            key.append(array.dtype)
            key.append(array.shape)
        known = tuple(key)
        try:
            start = self._written.get(known)
        except TypeError:  # not hashable, for instance a list within a list
            return self._start(self._encoded(message, []), arrays)
        if start is None:
            is_sent_as_is = all(array.dtype in CODES for array in arrays)
            start = self._start(self._encoded(message, []), arrays)
            if is_sent_as_is and len(start.data) <= _LONGEST_KNOWN:
                if len(self._written) >= _KNOWN:
                    self._written.clear()
                self._written[known] = start
        return start

    def _start(self, fields: bytes, arrays: list[AnyArray]) -> Start:
        """Convert arrays of other types to double precision, in place, and return the start of their message."""
        for place, array in enumerate(arrays):
            if array.dtype not in CODES:
                arrays[place] = array.astype(DOUBLE)
        return Start.of(fields, described(arrays))

    def _encoded(self, message: Message, arrays: list[AnyArray]) -> bytes:
        """Return the encoded fields of a message, and append its arrays to ``arrays``."""

        def next_array(value: Any) -> msgspec.msgpack.Ext:
            if not isinstance(value, np.ndarray):
                raise NotImplementedError(f"cannot send a {type(value).__name__}")
            arrays.append(value)
            return _NEXT_ARRAY

        # Arrays come last: first those that are fields, then dictionaries, in the order of ``_known_start``.
        names = (*self._constants, *self._arrays, *self._tables)
        return msgspec.msgpack.Encoder(enc_hook=next_array).encode({name: getattr(message, name) for name in names})

    # --- from bytes ---

    def of_known_start(self, data: bytes, first: int, end: int, block: int, number: int) -> Message | None:
        """Return the message if a message with the same start was decoded before, else None.

        Args:
            data: Bytes with a valid checksum.
            first: End of the fields and start of the shapes [B].
            end: End of the shapes [B].
            block: ``block`` in the header.
            number: ``number`` in the header.
        """
        known = self._known.get(data[HEADER.size : end])
        if known is None or known.first != first or known.end != len(data):
            return None
        arrays = bytearray(memoryview(data)[known.begin :])
        values = known.constants.copy()
        for name in self._tables:
            values[name] = {}
        for name, inner, dtype, shape, begin in known.arrays:
            array: AnyArray = np.ndarray(shape, dtype, arrays, begin)
            if inner is None:
                values[name] = array
            else:
                values[name][inner] = array
        if (block and self._block is None) or (number and self._number is None):
            return None
        return self._with_header(values, block, number)

    def decode(self, frame: Frame) -> Message:
        """Decode a frame of this kind, and keep its fields if the kind is steady.

        Raises:
            ValueError, msgspec.DecodeError, struct.error, RecursionError: The frame is invalid.
        """
        places = known_places(frame.shapes)
        if places.size != len(frame.arrays):
            raise ValueError(f"its arrays take {places.size} bytes but there are {len(frame.arrays)}")
        # A copy of all arrays, so that none keeps the message alive and all are aligned like other arrays: sums
        # over unaligned arrays may differ in the last digit.
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
        if self.kind.is_steady and len(frame.fields) + len(frame.shapes) <= _LONGEST_KNOWN:
            if len(self._known) >= _KNOWN:
                self._known.clear()
            self._known[frame.fields + frame.shapes] = self._to_known(frame, values, arrays, places)
        return self._with_header(values, frame.block, frame.number)

    def _to_known(self, frame: Frame, values: dict[str, Any], arrays: list[AnyArray], places: Places) -> _Known:
        """Return the start in the form that is kept, with the order in which it names arrays."""
        names: dict[int, tuple[str, str | None]] = {id(values[name]): (name, None) for name in self._arrays}
        for table in self._tables:
            names |= {id(array): (table, name) for name, array in values[table].items()}
        if len(names) != len(arrays):
            raise ValueError(f"it has {len(arrays)} arrays but {len(names)} names for them")
        first = HEADER.size + len(frame.fields)
        begin = padded(first + len(frame.shapes))
        return _Known(
            first=first,
            begin=begin,
            end=begin + places.size,
            constants={name: values[name] for name in self._constants},
            arrays=[(*names[id(array)], *place) for array, place in zip(arrays, places.each, strict=True)],
        )

    def _with_header(self, values: dict[str, Any], block: int, number: int) -> Message:
        """Return the message with these fields and those from the header."""
        for name, value in ((self._block, block), (self._number, number)):
            if name is not None:
                values[name] = value
            elif value:
                raise ValueError(f"its header has {value} for a field that this kind does not have")
        return self.kind(**values)
