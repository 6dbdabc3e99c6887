"""Recordings of protocol version 5, as a run of ``ring3`` made them, are still read."""

from __future__ import annotations

import base64
import json
from pathlib import Path

import numpy as np
import pytest

from coheft.app.recording.raw import from_raw
from coheft.errors import MessageError
from coheft.wire.messages.codec import decode
from coheft.wire.messages.requests import Status
from coheft.wire.messages.structs import Estimate
from coheft.wire.messages.truth import Truth

FORMER = {
    topic: base64.b64decode(text)
    for topic, text in json.loads(Path(__file__).with_name("former_messages.json").read_text()).items()
}


def test_former_messages_are_read() -> None:
    status, truth, estimate = (
        from_raw(f"/coheft/{name}", FORMER[f"/coheft/{name}"]) for name in ("status", "truth", "estimate")
    )
    assert isinstance(status, Status)
    assert status.scenario == "ring3"
    assert isinstance(truth, Truth)
    assert truth.payload.mass == pytest.approx(5.0)
    assert isinstance(estimate, Estimate)
    assert estimate.payload is not None
    assert estimate.payload.mass == pytest.approx(truth.payload.mass, abs=0.1)
    assert np.shape(estimate.payload.covariance) == (10, 10)


def test_damage_is_told() -> None:
    topic = "/coheft/truth"
    data = bytearray(FORMER[topic])
    data[20] ^= 1
    with pytest.raises(MessageError, match="its checksum is wrong"):
        from_raw(topic, bytes(data))
    with pytest.raises(MessageError, match="its checksum is wrong"):
        from_raw("/coheft/status", FORMER[topic])


def test_on_a_link_they_are_refused() -> None:
    with pytest.raises(MessageError, match="has protocol version 5 or older"):
        decode(FORMER["/coheft/truth"], Truth, "/coheft/truth")
