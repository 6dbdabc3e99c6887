"""The physics server's process without physics, with the same links and messages, see ``benchmarks.floor``."""

from collections.abc import Mapping, Sequence
from unittest.mock import patch

from msgspec.structs import replace

from coheft.physics_server import server
from coheft.physics_server.simulation import BlockResult, Simulation
from coheft.wire.messages.structs import Reference
from coheft.wire.scenario.schema import Scenario


class BareSimulation(Simulation):
    """Simulates one block, and repeats its measurements with the next numbers."""

    def __init__(self, scenario: Scenario, neighbours: Mapping[str, Sequence[str]] | None = None) -> None:
        super().__init__(scenario, neighbours)
        self._result = super().advance({})
        self.block = 0

    def advance(self, references: Mapping[str, Reference]) -> BlockResult:
        """See ``Simulation``."""
        block, self.block = self.block, self.block + 1
        measurements = {name: replace(each, block=block) for name, each in self._result.measurements.items()}
        return BlockResult(measurements, replace(self._result.truth, block=block))


if __name__ == "__main__":
    with patch.object(server, "Simulation", BareSimulation):
        server.main()
