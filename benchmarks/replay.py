"""What agents say in a real run, kept so that it can be said again without the mathematics that made it."""

from __future__ import annotations

import statistics
from collections.abc import Sequence
from pathlib import Path

import msgspec

from benchmarks.stepped_team import SteppedTeam
from coheft.agents.agent import Outbox
from coheft.estimation.measurement import MeasurementBlock
from coheft.wire.config import AgentConfig
from coheft.wire.messages.codec import decode, encode
from coheft.wire.messages.structs import Estimate, NeighbourMessage, Reference
from coheft.wire.scenario.schema import Scenario

BLOCKS = 50
"""So many blocks in a row are kept, and said over and over."""
SETTING = "replay"
"""Key of the estimator's settings under which an agent finds its file."""
_KEY = "replay"


def record(scenario: Scenario, folder: Path) -> dict[str, Path]:
    """Run a scenario in this process until it has settled, and write what each agent says then to a file."""
    team = SteppedTeam(scenario)
    team.settle()
    said: dict[str, list[tuple[bytes, bytes, bytes]]] = {name: [] for name in team.graph}
    for _ in range(BLOCKS):
        team.step()
        for name, outbox in team.outboxes.items():
            estimate = b"" if outbox.estimate is None else encode(outbox.estimate, _KEY)
            said[name].append((encode(outbox.message, _KEY), encode(outbox.reference, _KEY), estimate))
    files = {name: folder / f"{name}.replay" for name in said}
    for name, path in files.items():
        path.write_bytes(msgspec.msgpack.encode(said[name]))
    return files


def sizes(path: Path) -> tuple[int, int]:
    """Of an agent's message to its neighbours and of its answer to the server: medians of what is in its file [B]."""
    said = _load(path)
    message, reference = (round(statistics.median(len(each[k]) for each in said)) for k in (0, 1))
    return message, reference


class BareAgent:
    """An agent that answers with what another one said once; ``coheft.agents.process`` takes it for an ``Agent``."""

    def __init__(self, config: AgentConfig, incarnation: int, largest_arrays: int) -> None:
        self._config = config
        self._incarnation = incarnation
        self._said = _read(Path(config.estimator_settings[SETTING]))

    def set_holding(self, holding: bool, from_block: int) -> None:
        """Hands make no difference."""

    def step(self, index: int, block: MeasurementBlock | None, inbox: Sequence[NeighbourMessage]) -> Outbox:
        """Say the next thing, as if it were of this block."""
        message, reference, estimate = self._said[index % len(self._said)]
        return Outbox(
            message=msgspec.structs.replace(message, block=index, incarnation=self._incarnation),
            reference=msgspec.structs.replace(reference, block=index + self._config.lag, answers=index),
            estimate=None if estimate is None else msgspec.structs.replace(estimate, block=index),
        )


def _read(path: Path) -> list[tuple[NeighbourMessage, Reference, Estimate | None]]:
    return [
        (
            decode(message, NeighbourMessage, _KEY),
            decode(reference, Reference, _KEY),
            decode(estimate, Estimate, _KEY) if estimate else None,
        )
        for message, reference, estimate in _load(path)
    ]


def _load(path: Path) -> list[tuple[bytes, bytes, bytes]]:
    return msgspec.msgpack.decode(path.read_bytes(), type=list[tuple[bytes, bytes, bytes]])
