"""Messages survive the wire, and nothing else passes for one."""

from __future__ import annotations

import contextlib
import math
import types
import typing
from typing import Any

import msgspec
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import array_shapes, arrays

from coheft.errors import MessageError
from coheft.wire import codec, messages
from coheft.wire.codec import decode, encode, seal
from coheft.wire.messages import PROTOCOL_VERSION, Hello, Measurements, Message, Request, Stop

KEY = "run-1/agent/r1/block"
KINDS = [
    kind
    for kind in vars(messages).values()
    if isinstance(kind, type) and issubclass(kind, Message) and kind is not Message
]


def values(kind: Any) -> st.SearchStrategy[Any]:
    """Anything that a field of this type may hold."""
    origin, arguments = typing.get_origin(kind), typing.get_args(kind)
    if kind is float:
        return st.floats(allow_nan=False)
    if kind is int:
        return st.integers(-(2**63), 2**63 - 1)
    if origin is np.ndarray:
        return arrays(np.float64, array_shapes(min_dims=0, max_dims=4, min_side=0, max_side=4))
    if origin is typing.Literal:
        return st.sampled_from(arguments)
    if origin in (types.UnionType, typing.Union):
        return st.one_of(*(values(argument) for argument in arguments))
    if kind is type(None):
        return st.none()
    if origin is list:
        return st.lists(values(arguments[0]), max_size=3)
    if origin is dict:
        return st.dictionaries(values(arguments[0]), values(arguments[1]), max_size=3)
    if origin is tuple and arguments[-1] is not Ellipsis:
        return st.tuples(*(values(argument) for argument in arguments))
    if origin is tuple:
        return st.lists(values(arguments[0]), max_size=3).map(tuple)
    if issubclass(kind, msgspec.Struct):
        hints = typing.get_type_hints(kind)
        return st.builds(kind, **{name: values(hint) for name, hint in hints.items() if name in fields_of(kind)})
    return st.from_type(kind)


def fields_of(kind: type[msgspec.Struct]) -> list[str]:
    return [name for name in kind.__struct_fields__ if name != "version"]


def plain(value: Any) -> Any:
    """With arrays as their shape and bytes, so that messages can be compared, NaNs included."""
    if isinstance(value, np.ndarray):
        return value.shape, value.tobytes()
    if isinstance(value, msgspec.Struct):
        return type(value), [plain(getattr(value, name)) for name in value.__struct_fields__]
    if isinstance(value, dict):
        return {key: plain(inner) for key, inner in value.items()}
    if isinstance(value, list | tuple):
        return [plain(inner) for inner in value]
    return value


@pytest.mark.parametrize("kind", KINDS, ids=lambda kind: kind.__name__)
@settings(max_examples=25)
@given(data=st.data())
def test_round_trip(kind: type[Message], data: st.DataObject) -> None:
    message = data.draw(values(kind))
    assert plain(decode(encode(message, KEY), kind, KEY)) == plain(message)


@given(data=st.data())
def test_requests_are_told_apart(data: st.DataObject) -> None:
    request = data.draw(values(Request))
    assert type(decode(encode(request, KEY), Request, KEY)) is type(request)


def _decode_or_refuse(data: bytes, kind: type[Message]) -> None:
    try:
        found = decode(data, kind, KEY)
    except MessageError:
        return
    assert isinstance(found, kind)


@pytest.mark.parametrize("kind", KINDS, ids=lambda kind: kind.__name__)
@settings(max_examples=25)
@given(data=st.data())
def test_damaged_bytes_are_refused_or_still_a_message(kind: type[Message], data: st.DataObject) -> None:
    sound = encode(data.draw(values(kind)), KEY)
    length = data.draw(st.integers(0, len(sound) - 1))
    with pytest.raises(MessageError):
        decode(sound[:length], kind, KEY)
    with pytest.raises(MessageError):
        decode(sound + data.draw(st.binary(min_size=1, max_size=8)), kind, KEY)
    flipped = bytearray(sound)
    for _ in range(data.draw(st.integers(1, 3))):
        bit = data.draw(st.integers(0, 8 * len(sound) - 1))
        flipped[bit // 8] ^= 1 << bit % 8
    with pytest.raises(MessageError, match="checksum") if bytes(flipped) != sound else contextlib.nullcontext():
        decode(bytes(flipped), kind, KEY)


@pytest.mark.parametrize("key", ["run-2/agent/r1/block", "run-1/agent/r2/block", "run-1/agent/r1/hello"])
def test_what_was_said_under_another_key_is_refused(key: str) -> None:
    """In an older run, by another agent, under another topic."""
    data = encode(Hello(sender="r1", heard=["r2"]), key)
    assert decode(data, Hello, key).heard == ["r2"]
    with pytest.raises(MessageError, match="of another run, sender or topic"):
        decode(data, Hello, KEY)


@given(st.binary(max_size=200), st.sampled_from(KINDS))
def test_any_bytes_are_refused_or_a_message(data: bytes, kind: type[Message]) -> None:
    with pytest.raises(MessageError):
        decode(data, kind, KEY)
    _decode_or_refuse(seal(data, KEY), kind)


@pytest.mark.parametrize(
    "data",
    [
        b"",
        b"\x81\xa1x" + 100_000 * b"\x91",  # nested too deeply, in a field that nobody knows
        b"\x81\xa5heard\xdd\xff\xff\xff\xff",  # a list of four billion
        b"\x81\xa1\xff\x01",  # not UTF-8
    ],
)
def test_hostile_bytes_are_refused(data: bytes) -> None:
    with pytest.raises(MessageError, match="not a Hello"):
        decode(seal(data, KEY), Hello, KEY)


def _with_array(shape: list[int], numbers: int) -> bytes:
    header = bytes([len(shape)]) + b"".join(side.to_bytes(4, "little") for side in shape)
    array = msgspec.msgpack.Ext(1, header + bytes(8 * numbers))
    return msgspec.msgpack.encode({"version": PROTOCOL_VERSION, "robot": "r1", "block": 0, "samples": array})


@pytest.mark.parametrize(
    ("shape", "numbers"), [([2, 3], 5), ([2, 3], 7), ([2**32 - 1] * 4, 1), ([1] * 5, 1), ([], 0), ([], 2)]
)
def test_arrays_that_are_not_what_their_header_says_are_refused(shape: list[int], numbers: int) -> None:
    with pytest.raises(MessageError, match="not a Measurements"):
        decode(seal(_with_array(shape, numbers), KEY), Measurements, KEY)


def test_array_of_the_wrong_code_is_refused() -> None:
    fields = {"version": PROTOCOL_VERSION, "robot": "r1", "block": 0, "samples": msgspec.msgpack.Ext(2, b"\x00" * 9)}
    with pytest.raises(MessageError, match="not an array"):
        decode(seal(msgspec.msgpack.encode(fields), KEY), Measurements, KEY)


@pytest.mark.parametrize("fields", [{"reason": "over"}, {"reason": 3}, {"what": "new"}])
def test_other_versions_are_told(fields: dict[str, object]) -> None:
    data = msgspec.msgpack.encode({"version": PROTOCOL_VERSION + 1} | fields)
    with pytest.raises(MessageError, match=f"version {PROTOCOL_VERSION + 1}.*speaks version {PROTOCOL_VERSION}"):
        decode(seal(data, KEY), Stop, KEY)


def test_what_is_no_array_cannot_be_sent() -> None:
    with pytest.raises(NotImplementedError, match="cannot send a complex"):
        encode(Hello(sender="r1", heard=typing.cast("list[str]", [1j])), KEY)


def test_check_array() -> None:
    array = np.array([[1.0, math.nan], [math.inf, 0.0]])
    with pytest.raises(MessageError, match="2 numbers that are not finite"):
        codec.check_array(array, (2, 2), "samples")
    with pytest.raises(MessageError, match=r"samples.shape is \(2, 2\) but expected \(2, 3\)"):
        codec.check_array(array, (2, 3), "samples")


def test_check_field() -> None:
    codec.check_field("block", 3, 3)
    with pytest.raises(MessageError, match="block is 3 but expected 4"):
        codec.check_field("block", 3, 4)
