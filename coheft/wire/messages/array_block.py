"""The arrays of a message: their types, their shapes, and their offsets in the block that holds them all."""

import math
import struct
from collections.abc import Iterable
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from coheft.wire.messages.frame import WORD, padded

AnyArray = npt.NDArray[Any]
DTYPES: dict[int, np.dtype[Any]] = {1: np.dtype("<f8"), 2: np.dtype("<f4"), 3: np.dtype("<i4"), 4: np.dtype("<i8")}
"""Types of arrays, by code; arrays of other types are sent in double precision."""
CODES = {dtype: code for code, dtype in DTYPES.items()}
DOUBLE = DTYPES[1]
MAX_DIMENSIONS = 4
"""Largest number of dimensions of an array."""


class Place(NamedTuple):
    """Type and shape of an array, and its offset in the block of all arrays of its message [B]."""

    dtype: np.dtype[Any]
    shape: tuple[int, ...]
    begin: int


class Places(NamedTuple):
    """Places of all arrays of a message, and their total size [B]."""

    each: tuple[Place, ...]
    size: int


def described(arrays: Iterable[AnyArray]) -> bytes:
    """Encode types and shapes as words: for each array its type, its number of dimensions, and its dimensions."""
    words: list[int] = []
    for array in arrays:
        words += CODES[array.dtype], array.ndim, *array.shape
    return struct.pack(f"<{len(words)}I", *words)


def places_of(shapes: bytes) -> Places:
    """Decode what ``described`` has encoded; raise ``ValueError`` if the bytes are something else."""
    words = struct.unpack(f"<{len(shapes) // WORD}I", shapes)
    places: list[Place] = []
    at = end = 0
    while at < len(words):
        code, dimensions = words[at], words[at + 1] if at + 1 < len(words) else 0
        shape = words[at + 2 : at + 2 + dimensions]
        if code not in DTYPES or dimensions > MAX_DIMENSIONS or at + 2 + dimensions > len(words):
            raise ValueError(f"expected arrays of types 1 to {len(DTYPES)} and at most {MAX_DIMENSIONS} dimensions")
        places.append(Place(DTYPES[code], shape, end))
        end += padded(DTYPES[code].itemsize * math.prod(shape))
        at += 2 + dimensions
    return Places(tuple(places), end)


_known = lru_cache(maxsize=256)(places_of)
_SHORT = 512


def known_places(shapes: bytes) -> Places:
    """Return the same as ``places_of``, faster for shapes that are repeated."""
    return _known(shapes) if len(shapes) <= _SHORT else places_of(shapes)
