"""Messages survive the wire, and nothing else passes for one."""

from __future__ import annotations

import math
import typing

import msgspec
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from coheft.errors import MessageError
from coheft.wire.messages import codec
from coheft.wire.messages.codec import decode, encode, seal
from coheft.wire.messages.requests import Request
from coheft.wire.messages.structs import PROTOCOL_VERSION, Hello, Measurements, Message, Stop
from tests.fuzz.any_message import KEY, KINDS, name_of, plain, values


@pytest.mark.parametrize("kind", KINDS, ids=name_of)
@settings(max_examples=25)
@given(data=st.data())
def test_round_trip(kind: type[Message], data: st.DataObject) -> None:
    message = data.draw(values(kind))
    assert plain(decode(encode(message, KEY), kind, KEY)) == plain(message)


@given(data=st.data())
def test_requests_are_told_apart(data: st.DataObject) -> None:
    request = data.draw(values(Request))
    assert type(decode(encode(request, KEY), Request, KEY)) is type(request)


@pytest.mark.parametrize("kind", KINDS, ids=name_of)
@settings(max_examples=25)
@given(data=st.data())
def test_damaged_bytes_are_refused(kind: type[Message], data: st.DataObject) -> None:
    """Even where they would still be a message."""
    sound = encode(data.draw(values(kind)), KEY)
    length = data.draw(st.integers(0, len(sound) - 1))
    more = data.draw(st.binary(min_size=1, max_size=8))
    flipped = bytearray(sound)
    for bit in data.draw(st.sets(st.integers(0, 8 * len(sound) - 1), min_size=1, max_size=3)):
        flipped[bit // 8] ^= 1 << bit % 8
    for damaged in (sound[:length], sound + more, bytes(flipped)):
        with pytest.raises(MessageError, match="its checksum does not fit"):
            decode(damaged, kind, KEY)


@pytest.mark.parametrize("key", ["run-2/agent/r1/block", "run-1/agent/r2/block", "run-1/agent/r1/hello"])
def test_what_was_said_under_another_key_is_refused(key: str) -> None:
    """In an older run, by another agent, under another topic."""
    data = encode(Hello(sender="r1", heard=["r2"]), key)
    assert decode(data, Hello, key).heard == ["r2"]
    with pytest.raises(MessageError, match="of another run, sender or topic"):
        decode(data, Hello, KEY)


@pytest.mark.parametrize(
    "data",
    [
        b"",
        b"\x81\xa1x" + 100_000 * b"\x91",  # nested too deeply, in a field that no one knows
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


@pytest.mark.parametrize("data", [b"", b"\x02", b"\x02\x01\x00\x00\x00", b"\x01\x01\x00\x00\x00" + 7 * b"\x00"])
def test_arrays_that_are_cut_short_are_refused(data: bytes) -> None:
    fields = {"version": PROTOCOL_VERSION, "robot": "r1", "block": 0, "samples": msgspec.msgpack.Ext(1, data)}
    with pytest.raises(MessageError, match="not a Measurements"):
        decode(seal(msgspec.msgpack.encode(fields), KEY), Measurements, KEY)


def test_array_of_the_wrong_code_is_refused() -> None:
    fields = {"version": PROTOCOL_VERSION, "robot": "r1", "block": 0, "samples": msgspec.msgpack.Ext(9, b"\x00" * 9)}
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


def test_errors_quote_messages_in_one_short_line() -> None:
    with pytest.raises(MessageError, match=r"unknown field `\\x1b\[2J\\nr1 is fine`$"):
        decode(seal(b"\x81\xaf\x1b[2J\nr1 is fine\x01", KEY), Hello, KEY)
    with pytest.raises(MessageError, match=r"^.{400}\.\.\.$"):
        codec.check_field("sender", 10_000 * "a", "r1")


def test_check_field() -> None:
    codec.check_field("block", 3, 3)
    with pytest.raises(MessageError, match="block is 3 but expected 4"):
        codec.check_field("block", 3, 4)
