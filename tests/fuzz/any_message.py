"""Whatever a message may hold, and what can become of one."""

from __future__ import annotations

import math
import types
import typing
from typing import Any

import msgspec
import numpy as np
from hypothesis import strategies as st
from hypothesis.extra.numpy import array_shapes, arrays

from coheft.wire.cart import messages as cart_messages
from coheft.wire.messages import structs
from coheft.wire.messages.codec import encode
from coheft.wire.messages.frame import KeyChecksum
from coheft.wire.messages.requests import Request
from coheft.wire.messages.structs import Message

KEY = "run-1/agent/r1/block"
KEY_CHECKSUM = KeyChecksum(KEY)
KINDS: list[Any] = [
    kind
    for kind in (*vars(structs).values(), *vars(cart_messages).values())
    if isinstance(kind, type) and issubclass(kind, Message) and kind is not Message
] + [Request]


def name_of(kind: Any) -> str:
    """For the ids of parametrised tests."""
    return getattr(kind, "__name__", "Request")


def values(kind: Any) -> st.SearchStrategy[Any]:
    """Anything that a field of this type may hold."""
    origin, arguments = typing.get_origin(kind), typing.get_args(kind)
    if kind is float:
        return st.floats(allow_nan=False)
    if kind is int:
        return st.integers(-(2**63), 2**63 - 1)
    if origin is typing.Annotated:
        return limited(arguments[0], arguments[1])
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
        return st.builds(kind, **{field.name: values(field.type) for field in msgspec.structs.fields(kind)})
    return st.from_type(kind)


def limited(kind: Any, limits: msgspec.Meta) -> st.SearchStrategy[Any]:
    """Anything of this type within its limits."""
    if kind is float:
        return st.floats(typing.cast("float", limits.ge), typing.cast("float", limits.le))
    if kind is int:
        return st.integers(typing.cast("int", limits.ge), typing.cast("int", limits.lt) - 1)
    return values(kind).filter(lambda value: len(value) <= typing.cast("int", limits.max_length))


def fields_of(sound: bytes) -> Any:
    """The fields of a message, as nested builtins."""
    return msgspec.msgpack.decode(KEY_CHECKSUM.unwrapped(sound, "message").fields)


def with_fields(sound: bytes, fields: bytes, shapes: bytes | None = None) -> bytes:
    """A message with other fields, and perhaps other shapes."""
    frame = KEY_CHECKSUM.unwrapped(sound, "message")
    arrays = [np.frombuffer(frame.arrays, np.uint8)]
    shapes = frame.shapes if shapes is None else shapes
    return KEY_CHECKSUM.wrapped(frame.code, frame.block, frame.number, fields, shapes, arrays)


def of_version(version: int, message: Message, key: str) -> bytes:
    """A message as a process of another protocol version would say it, if nothing else had changed."""
    body = bytearray(encode(message, key)[4:])
    body[0] = version
    return KeyChecksum(key).close(bytes(body))


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
    return repr(value) if isinstance(value, float) else value


_LENGTH_HEADERS = [b"\xdd", b"\xdf", b"\xdb", b"\xc6", b"\xc9"]
"""MessagePack's array, map, string, bytes and extension, with four bytes of length."""


@st.composite
def damaged(draw: st.DrawFn, sound: bytes, other: bytes) -> bytes:
    """What may become of some bytes on their way: flipped bits, pieces lost, doubled, or of others, false lengths."""
    data = bytearray(sound)
    for _ in range(draw(st.integers(1, 3))):
        place = draw(st.integers(0, len(data)))
        end = min(len(data), place + draw(st.integers(0, 16)))
        match draw(st.sampled_from(["flip", "cut", "lose", "repeat", "splice", "overwrite", "length", "nest"])):
            case "flip" if data:
                data[place % len(data)] ^= 1 << draw(st.integers(0, 7))
            case "cut":
                del data[place:]
            case "lose":
                del data[place:end]
            case "repeat":
                data[end:end] = data[place:end]
            case "splice":
                start = draw(st.integers(0, len(other)))
                data[place:end] = other[start : start + draw(st.integers(0, 64))]
            case "overwrite":
                data[place:end] = draw(st.binary(max_size=16))
            case "length":
                header = draw(st.sampled_from(_LENGTH_HEADERS))
                data[place:end] = header + draw(st.sampled_from([2**32 - 1, 2**31, 2**24])).to_bytes(4, "big")
            case "nest":
                data[place:place] = draw(st.sampled_from([b"\x91", b"\x81\xa1a"])) * draw(
                    st.sampled_from([100, 2_000, 50_000])
                )
    return bytes(data)


_texts = st.text(max_size=8) | st.sampled_from([3_000 * "a", "\n\x1b[2J"])
_integers = st.integers(-(2**63), 2**64 - 1)


def trees() -> st.SearchStrategy[Any]:
    """Anything that MessagePack can say."""
    leaves = (
        st.none()
        | st.booleans()
        | _integers
        | st.floats()
        | _texts
        | st.binary(max_size=8)
        | st.builds(msgspec.msgpack.Ext, st.integers(-128, 127), st.binary(max_size=40))
        | array_extensions()
    )
    return st.recursive(
        leaves,
        lambda inner: st.lists(inner, max_size=4) | st.dictionaries(_texts | _integers, inner, max_size=4),
        max_leaves=12,
    )


def array_extensions() -> st.SearchStrategy[msgspec.msgpack.Ext]:
    """What stands for an array, or looks like it."""
    return st.builds(msgspec.msgpack.Ext, st.sampled_from([1, 1, 1, 2]), st.just(b"") | st.binary(max_size=5))


@st.composite
def any_shapes(draw: st.DrawFn) -> bytes:
    """Types and shapes of arrays, which need not be those of any that are there, nor be any."""
    words = st.integers(0, 5) | st.sampled_from([2**16, 2**31, 2**32 - 1])
    found = draw(st.lists(words, max_size=12))
    return b"".join(word.to_bytes(4, "little") for word in found)


@st.composite
def with_a_part_replaced(draw: st.DrawFn, tree: Any, by: st.SearchStrategy[Any]) -> Any:
    """Nested builtins in which something else stands in one place, or a place is missing or too many."""
    inner: list[Any] = list(tree) if isinstance(tree, dict | list) else []
    if isinstance(tree, list):
        inner = list(range(len(tree)))
    action = draw(st.sampled_from(["go in", "go in", "go in", "replace", "remove", "add"] if inner else ["replace"]))
    if action == "replace":
        return draw(by)
    key = draw(st.sampled_from(inner))
    changed = tree.copy()
    if action == "go in":
        changed[key] = draw(with_a_part_replaced(tree[key], by))
    elif action == "remove":
        del changed[key]
    elif isinstance(tree, dict):
        changed[draw(_texts | st.sampled_from(inner))] = draw(by)
    else:
        changed.insert(key, draw(by))
    return changed


NUMBERS = st.sampled_from([0.0, -1.0, math.nan, math.inf, -math.inf, 1e300, -1e14, 1e-300]) | st.floats()


@st.composite
def altered(draw: st.DrawFn, value: Any) -> Any:
    """The same with another value of the same type in one place."""
    match value:
        case msgspec.Struct():
            name = draw(st.sampled_from(value.__struct_fields__))
            return msgspec.structs.replace(value, **{name: draw(altered(getattr(value, name)))})
        case np.ndarray():
            changed, place = value.copy(), draw(st.integers(0, value.size - 1))
            if value.dtype.kind == "f":
                with np.errstate(over="ignore"):
                    changed.flat[place] = draw(NUMBERS)
            else:
                limits = np.iinfo(value.dtype)
                changed.flat[place] = draw(st.integers(int(limits.min), int(limits.max)))
            return changed
        case dict() if value:
            name = draw(st.sampled_from(sorted(value)))
            if draw(st.booleans()):
                return value | {name: draw(altered(value[name]))}
            return {draw(st.text(max_size=3)) if key == name else key: inner for key, inner in value.items()}
        case list() | tuple() if value:
            place = draw(st.integers(0, len(value) - 1))
            return [draw(altered(inner)) if k == place else inner for k, inner in enumerate(value)]
        case bool() | None:
            return value
        case float():
            return draw(NUMBERS)
        case int():
            return draw(st.sampled_from([-1, 0, 2**63 - 1]) | st.integers(-(2**63), 2**63 - 1))
        case "valid" | "stale" | "starting" | "poses" | "inertia":
            return value
        case str():
            return draw(st.text(max_size=12))
    return value
