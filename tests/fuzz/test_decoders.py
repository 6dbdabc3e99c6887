"""No bytes, however malformed, make a decoder do anything but refuse them or find a sound message, in little memory."""

from __future__ import annotations

import tracemalloc
from typing import Any

import msgspec
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from coheft.errors import MessageError
from coheft.wire.messages.codec import decode, encode
from coheft.wire.messages.structs import Message
from tests.fuzz.any_message import (
    KEY,
    KEY_CHECKSUM,
    KINDS,
    any_shapes,
    damaged,
    fields_of,
    plain,
    trees,
    values,
    with_a_part_replaced,
    with_fields,
)

_MEMORY = 1 << 17
_MEMORY_PER_BYTE = 100

many = settings(max_examples=3 * settings.default.max_examples)
kinds = st.sampled_from(KINDS)


def decode_or_refuse(data: bytes, kind: Any) -> None:
    """What arrived as it was sent, by somebody who means ill."""
    refusal = None
    tracemalloc.start()
    try:
        message = decode(data, kind, KEY)
    except MessageError as error:
        refusal = str(error)
    finally:
        peak = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
        assert peak < _MEMORY + _MEMORY_PER_BYTE * len(data)
    if refusal is not None:
        assert refusal.isprintable()  # it goes into logs, and to observers
        assert len(refusal) < 1000
        return
    assert isinstance(message, Message)
    assert plain(decode(encode(message, KEY), kind, KEY)) == plain(message)


@many
@given(kind=kinds, data=st.data())
def test_damaged_messages(kind: Any, data: st.DataObject) -> None:
    sound, other = (encode(data.draw(values(kind)), KEY) for kind in (kind, data.draw(kinds)))
    decode_or_refuse(KEY_CHECKSUM.close(data.draw(damaged(sound[4:], other[4:]))), kind)
    bad = data.draw(damaged(sound, other))
    if bad not in (sound, other):
        with pytest.raises(MessageError):
            decode(bad, kind, KEY)


@many
@given(kind=kinds, data=st.data())
def test_messages_with_something_else_in_a_place(kind: Any, data: st.DataObject) -> None:
    sound = encode(data.draw(values(kind)), KEY)
    changed = data.draw(with_a_part_replaced(fields_of(sound), trees()))
    decode_or_refuse(with_fields(sound, msgspec.msgpack.encode(changed)), kind)


@many
@given(kind=kinds, shapes=any_shapes(), data=st.data())
def test_arrays_of_other_shapes(kind: Any, shapes: bytes, data: st.DataObject) -> None:
    sound = encode(data.draw(values(kind)), KEY)
    decode_or_refuse(sound, kind)  # so that its fields are known
    decode_or_refuse(with_fields(sound, KEY_CHECKSUM.unwrapped(sound, "message").fields, shapes), kind)


@many
@given(kind=kinds, tree=trees(), data=st.data())
def test_any_tree(kind: Any, tree: Any, data: st.DataObject) -> None:
    sound = encode(data.draw(values(kind)), KEY)
    decode_or_refuse(with_fields(sound, msgspec.msgpack.encode(tree)), kind)


@many
@given(kinds, st.binary(max_size=300))
def test_any_bytes(kind: Any, data: bytes) -> None:
    decode_or_refuse(KEY_CHECKSUM.close(data), kind)
    with pytest.raises(MessageError):
        decode(data, kind, KEY)
