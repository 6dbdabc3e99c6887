"""Faults of single messages: flipped bits, lies, invalid contents, another run."""

import msgspec
import numpy as np

from coheft.app.faults.schedule import Corruption, Lie
from coheft.errors import MessageError
from coheft.estimation.geometry.spatial import Array
from coheft.wire.messages.codec import decode, encode
from coheft.wire.messages.frame import KeyChecksum
from coheft.wire.messages.structs import NeighbourMessage

_CHECKSUM_SIZE = 4
_FAR = 10**9
"""Index of a block that is never reached."""


def _key(message: NeighbourMessage, run: str = "run") -> str:
    return f"{run}/neighbours/{message.sender}"


def flip_bits(message: NeighbourMessage, fault: Corruption, rng: np.random.Generator) -> NeighbourMessage | None:
    """Return the message after some of its bits have flipped; None if the codec refuses it."""
    key = _key(message)
    data = bytearray(encode(message, key))
    first = 8 * _CHECKSUM_SIZE if fault.sealed else 0
    for bit in rng.integers(first, 8 * len(data), size=fault.bits):
        data[bit // 8] ^= 1 << (bit % 8)
    try:
        return decode(
            KeyChecksum(key).close(bytes(data[_CHECKSUM_SIZE:])) if fault.sealed else bytes(data), NeighbourMessage, key
        )
    except MessageError:
        return None


def is_refused_in_another_run(message: NeighbourMessage) -> bool:
    """Whether the codec refuses a message of another run."""
    try:
        decode(encode(message, _key(message, "other-run")), NeighbourMessage, _key(message))
    except MessageError:
        return True
    return False


def lie_about(message: NeighbourMessage, fault: Lie, rng: np.random.Generator) -> NeighbourMessage:
    """Return the message with wrong numbers in all samples and sums: its arrays of two or more dimensions."""
    channels = {
        name: _lie(array, fault, rng) if array.ndim > 1 and array.dtype.kind == "f" else array
        for name, array in sorted(message.channels.items())
    }
    return msgspec.structs.replace(message, channels=channels)


def _lie(array: Array, fault: Lie, rng: np.random.Generator) -> Array:
    rms = float(np.sqrt(np.square(array).mean())) if array.size else 0.0
    match fault.how:
        case "scaled":
            return fault.size * array
        case "offset":
            return array + fault.size * rms
        case "garbage":
            return (rms * rng.standard_normal(array.shape)).astype(array.dtype)


def malformed(message: NeighbourMessage, rng: np.random.Generator) -> NeighbourMessage:
    """Return an invalid message without gossip."""
    replace = msgspec.structs.replace
    nonsense = replace(message, gossip=[])
    match rng.integers(5) if message.channels else 0:
        case 0:
            return replace(nonsense, sender="stranger")
        case 1:
            return replace(nonsense, block=int(rng.choice([-_FAR, -1, _FAR])))
        case 2:
            return replace(nonsense, incarnation=-1)
        case 3:
            return replace(nonsense, channels={name: array[..., None] for name, array in message.channels.items()})
        case _:
            value = rng.choice([np.nan, np.inf, -np.inf])
            return replace(nonsense, channels={name: np.full(a.shape, value) for name, a in message.channels.items()})
