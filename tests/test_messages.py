"""Messages survive the wire, and nothing else passes for one."""

from __future__ import annotations

import math
import sys
import typing
from concurrent.futures import ThreadPoolExecutor

import msgspec
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from coheft.errors import MessageError
from coheft.wire.messages import codec
from coheft.wire.messages.codec import decode, encode
from coheft.wire.messages.frame import PROTOCOL_VERSION, KeyChecksum
from coheft.wire.messages.requests import Request, StatusRequest
from coheft.wire.messages.structs import Hello, Measurements, Message, Reference, Stop
from coheft.wire.messages.truth import Truth
from tests.fuzz.any_message import KEY, KEY_CHECKSUM, KINDS, fields_of, name_of, of_version, plain, values, with_fields


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
        with pytest.raises(MessageError, match="its checksum is wrong"):
            decode(damaged, kind, KEY)


@pytest.mark.parametrize("key", ["run-2/agent/r1/block", "run-1/agent/r2/block", "run-1/agent/r1/hello"])
def test_what_was_said_under_another_key_is_refused(key: str) -> None:
    """In an older run, by another agent, under another topic."""
    data = encode(Hello(sender="r1", heard=["r2"]), key)
    assert decode(data, Hello, key).heard == ["r2"]
    with pytest.raises(MessageError, match="from another run, sender or topic"):
        decode(data, Hello, KEY)


@pytest.mark.parametrize(
    "fields",
    [
        b"",
        b"\x81\xa1x" + 100_000 * b"\x91",  # nested too deeply, in a field that no one knows
        b"\x81\xa5heard\xdd\xff\xff\xff\xff",  # a list of four billion
        b"\x81\xa1\xff\x01",  # not UTF-8
    ],
)
def test_hostile_fields_are_refused(fields: bytes) -> None:
    with pytest.raises(MessageError, match="not a Hello"):
        decode(with_fields(encode(Hello(sender="r1", heard=[]), KEY), fields), Hello, KEY)


@pytest.mark.parametrize("size", range(41))
def test_what_is_too_short_for_what_its_header_says_is_refused(size: int) -> None:
    body = encode(Hello(sender="r1", heard=["r2"]), KEY)[4 : 4 + size]
    with pytest.raises(MessageError, match="not a Hello"):
        decode(KEY_CHECKSUM.close(body), Hello, KEY)


def _with_shapes(words: list[int], numbers: int) -> bytes:
    """Measurements whose array is said to be of another shape."""
    sound = encode(Measurements(robot="r1", block=0, samples=np.zeros(numbers)), KEY)
    assert decode(sound, Measurements, KEY).samples.shape == (numbers,)  # so that its fields are known
    shapes = b"".join(word.to_bytes(4, "little") for word in words)
    return with_fields(sound, KEY_CHECKSUM.unwrapped(sound, "message").fields, shapes)


@pytest.mark.parametrize(
    ("words", "numbers"),
    [
        ([1, 2, 2, 3], 4),  # more numbers than there are
        ([1, 2, 2, 3], 9),  # fewer
        ([1, 4, *[2**32 - 1] * 4], 1),
        ([1, 5, *[1] * 5], 2),  # five dimensions
        ([9, 1, 2], 2),  # of no type
        ([1, 2, 2], 2),  # cut short
        ([1], 2),
        ([1, 1, 2, 1, 1, 2], 4),  # two arrays
        ([], 0),
    ],
)
def test_arrays_that_are_not_what_is_said_of_them_are_refused(words: list[int], numbers: int) -> None:
    with pytest.raises(MessageError, match=r"not a Measurements: .*array"):
        decode(_with_shapes(words, numbers), Measurements, KEY)


@pytest.mark.parametrize(("code", "data"), [(9, b""), (1, b"?")])
def test_what_stands_for_no_array_is_refused(code: int, data: bytes) -> None:
    sound = encode(Measurements(robot="r1", block=0, samples=np.zeros(2)), KEY)
    fields = fields_of(sound) | {"samples": msgspec.msgpack.Ext(code, data)}
    with pytest.raises(MessageError, match="not an array"):
        decode(with_fields(sound, msgspec.msgpack.encode(fields)), Measurements, KEY)


def test_fields_may_name_arrays_in_any_order() -> None:
    reference = Reference(robot="r1", block=7, answers=3, motion=np.ones((2, 12)), wrench=np.arange(6.0))
    sound = encode(reference, KEY)
    frame = KEY_CHECKSUM.unwrapped(sound, "message")
    fields = msgspec.msgpack.encode(dict(reversed(fields_of(sound).items())))
    shapes = frame.shapes[-12:] + frame.shapes[:-12]
    swapped = KEY_CHECKSUM.wrapped(frame.code, 7, 3, fields, shapes, [reference.wrench, reference.motion])
    assert plain(decode(swapped, Reference, KEY)) == plain(reference)


def test_arrays_of_other_types_are_sent_in_double_precision_every_time() -> None:
    measurements = Measurements(robot="r1", block=7, samples=np.ones((2, 15)))
    for dtype in (np.float16, np.bool_, np.dtype(">f8"), np.float16, np.float64):
        sent = msgspec.structs.replace(measurements, samples=measurements.samples.astype(dtype))
        assert plain(decode(encode(sent, KEY), Measurements, KEY)) == plain(measurements)


def test_bytes_with_another_border_between_fields_and_shapes_are_refused() -> None:
    frame = KEY_CHECKSUM.unwrapped(encode(Measurements(robot="r1", block=7, samples=np.ones((2, 15))), KEY), "message")
    array = np.frombuffer(frame.arrays, np.uint8)
    moved = KEY_CHECKSUM.wrapped(frame.code, 7, 0, frame.fields[:-4], frame.fields[-4:] + frame.shapes, [array])
    with pytest.raises(MessageError, match="not a Measurements"):
        decode(moved, Measurements, KEY)
    with pytest.raises(MessageError, match="its arrays take 240 bytes but there are 224"):
        decode(KEY_CHECKSUM.wrapped(frame.code, 7, 0, frame.fields, frame.shapes, [array[16:]]), Measurements, KEY)


def test_threads_may_send_and_receive_messages_of_one_kind_at_the_same_time() -> None:
    def is_whole(number: int) -> bool:
        message = Reference(
            robot=f"r{number}", block=7, answers=3, motion=np.full((50, 12), float(number)), wrench=np.full(6, -1.0)
        )
        return all(plain(decode(encode(message, KEY), Reference, KEY)) == plain(message) for _ in range(200))

    before = sys.getswitchinterval()
    sys.setswitchinterval(1e-6)
    try:
        with ThreadPoolExecutor(4) as pool:
            assert all(pool.map(is_whole, range(4)))
    finally:
        sys.setswitchinterval(before)


def test_what_is_in_a_header_has_to_be_for_its_kind() -> None:
    frame = KEY_CHECKSUM.unwrapped(encode(Stop(reason="over"), KEY), "message")
    with pytest.raises(MessageError, match="not a Stop: its header has 3 for a field that this kind does not have"):
        decode(KEY_CHECKSUM.wrapped(frame.code, 3, 0, frame.fields, b"", []), Stop, KEY)
    with pytest.raises(MessageError, match="not a Hello: it is a Stop"):
        decode(encode(Stop(reason="over"), KEY), Hello, KEY)
    with pytest.raises(MessageError, match="not a Stop: it is a message of kind 99"):
        decode(KEY_CHECKSUM.wrapped(99, 0, 0, frame.fields, b"", []), Stop, KEY)
    other = KeyChecksum("run-2/agent/r1/block")
    other.seed = KEY_CHECKSUM.seed
    with pytest.raises(MessageError, match="its header has run"):
        decode(other.wrapped(frame.code, 0, 0, frame.fields, b"", []), Stop, KEY)


def test_no_two_kinds_have_the_same_code() -> None:
    kinds = [kind for kind in Message.__subclasses__() if kind.__module__.startswith("coheft.")]
    assert {Truth, Stop, *typing.get_args(Request)} <= set(kinds)
    codes = [kind.code for kind in kinds]
    assert len(set(codes)) == len(codes)


def test_other_versions_are_told() -> None:
    words = f"version {PROTOCOL_VERSION + 1}.*uses version {PROTOCOL_VERSION}"
    with pytest.raises(MessageError, match=words):
        decode(of_version(PROTOCOL_VERSION + 1, Stop(reason="over"), KEY), Stop, KEY)
    with pytest.raises(MessageError, match=words):
        decode(KEY_CHECKSUM.close(bytes([PROTOCOL_VERSION + 1])), Stop, KEY)


def test_other_versions_of_requests_are_told_with_what_to_do() -> None:
    data = of_version(PROTOCOL_VERSION + 1, StatusRequest(), KEY)
    with pytest.raises(MessageError, match=r"^not a StatusRequest or .* or ClockRequest: it has .* on all hosts$"):
        decode(data, typing.cast("type[Message]", Request), KEY)


def test_versions_before_there_were_headers_are_told() -> None:
    """Their messages were a map in MessagePack behind the same checksum."""
    body = msgspec.msgpack.encode({"version": 5, "reason": "over"})
    with pytest.raises(MessageError, match="version 5 or older, but this process uses version 6"):
        decode(KEY_CHECKSUM.close(body), Stop, KEY)


def test_what_is_no_array_cannot_be_sent() -> None:
    with pytest.raises(NotImplementedError, match="cannot send a complex"):
        encode(Hello(sender="r1", heard=typing.cast("list[str]", [1j])), KEY)


def test_check_numbers() -> None:
    array = np.array([[1.0, math.nan], [math.inf, 0.0]])
    with pytest.raises(MessageError, match="2 numbers that are not finite"):
        codec.check_numbers(array, (2, 2), "samples")
    with pytest.raises(MessageError, match=r"samples.shape is \(2, 2\) but expected \(2, 3\)"):
        codec.check_numbers(array, (2, 3), "samples")
    with pytest.raises(MessageError, match=r"samples\.dtype is 'int64' but expected 'float64'"):
        codec.check_numbers(np.ones(2, dtype=np.int64), (2,), "samples")
    with pytest.raises(MessageError, match=r"largest number of samples is 2e\+16 but expected less than 1e\+15"):
        codec.check_numbers(np.array([-2e16, 0.0]), (2,), "samples")


def test_errors_quote_messages_in_one_short_line() -> None:
    with pytest.raises(MessageError, match=r"unknown field `\\x1b\[2J\\nr1 is fine`$"):
        decode(with_fields(encode(Hello(sender="r1", heard=[]), KEY), b"\x81\xaf\x1b[2J\nr1 is fine\x01"), Hello, KEY)
    with pytest.raises(MessageError, match=r"^.{400}\.\.\.$"):
        codec.check_field("sender", 10_000 * "a", "r1")


def test_check_field() -> None:
    codec.check_field("block", 3, 3)
    with pytest.raises(MessageError, match="block is 3 but expected 4"):
        codec.check_field("block", 3, 4)
