"""An agent's process without mathematics, with the same links and messages, see ``benchmarks.floor``."""

from collections.abc import Sequence
from pathlib import Path
from unittest.mock import patch

from msgspec.structs import replace

from benchmarks.replay import SETTING, read
from coheft.agents.agent import Outbox
from coheft.agents.process import main as process
from coheft.estimation.measurement import MeasurementBlock
from coheft.wire.config import AgentConfig
from coheft.wire.messages.structs import NeighbourMessage


class BareAgent:
    """An agent that repeats recorded messages, with the interface of ``Agent``."""

    def __init__(self, config: AgentConfig, incarnation: int, largest_arrays: int, signer: object) -> None:
        self._config = config
        self._incarnation = incarnation
        self._recorded = read(Path(config.estimator_settings[SETTING]))

    def set_holding(self, holding: bool, from_block: int) -> None:
        """Ignore the grasp."""

    def step(self, index: int, block: MeasurementBlock | None, inbox: Sequence[NeighbourMessage]) -> Outbox:
        """Return the next recorded messages, with this block's number."""
        message, reference, estimate = self._recorded[index % len(self._recorded)]
        return Outbox(
            message=replace(message, block=index, incarnation=self._incarnation),
            reference=replace(reference, block=index + self._config.lag, answers=index),
            estimate=None if estimate is None else replace(estimate, block=index),
        )


if __name__ == "__main__":
    with patch.object(process, "Agent", BareAgent):
        process.main()
