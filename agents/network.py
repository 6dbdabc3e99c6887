"""Simulated loss and delay of neighbours' messages, applied where they arrive.

Loss and lateness of a message follow from seed, sender, receiver and block alone. So a run gives the same numbers in
one process and in many.
"""

from collections.abc import Iterable, Sequence

from coheft.wire.config import AgentConfig
from coheft.wire.messages.structs import NeighbourMessage
from coheft.wire.scenario.network import LinkQuality


class SimulatedNetwork:
    """Delivers the messages of one robot's neighbours."""

    def __init__(self, config: AgentConfig) -> None:
        self._name, self._seed, self._block = config.name, config.seed, config.start_of(1)
        self._links = dict.fromkeys(config.neighbours, config.network)
        self._is_ideal = config.network.is_ideal
        self._under_way: list[tuple[int, NeighbourMessage]] = []

    def set_link(self, neighbour: str, quality: LinkQuality) -> None:
        """Change the quality of the link from a neighbour, for messages that have not been sent yet."""
        self._links[neighbour] = quality
        self._is_ideal = all(each.is_ideal for each in self._links.values())

    def deliver(self, index: int, sent: Sequence[NeighbourMessage]) -> Sequence[NeighbourMessage]:
        """Return the messages that arrive for a block, given what neighbours have sent since the block before."""
        if self._is_ideal and not self._under_way:
            return sent
        arriving = [message for due, message in self._under_way if due <= index]
        self._under_way = [(due, message) for due, message in self._under_way if due > index]
        for message in sent:
            blocks = self._blocks_late(message)
            if blocks == 0:
                arriving.append(message)
            elif blocks is not None:
                self._under_way.append((index + blocks, message))
        return arriving

    def _blocks_late(self, message: NeighbourMessage) -> int | None:
        """Delay of a message in blocks; None if it is lost."""
        quality = self._links.get(message.sender)
        if quality is None or quality.is_ideal:
            return 0
        loss, jitter = _uniform(self._seed, message.sender, self._name, message.block)
        if loss < quality.loss:
            return None
        return int((quality.delay + jitter * quality.jitter) / self._block + 1e-9)


def _uniform(*labels: object) -> Iterable[float]:
    """Return two numbers that are uniformly distributed in [0, 1)."""
    import hashlib  # agents whose network is ideal start sooner without it

    drawn = hashlib.blake2b(repr(labels).encode(), digest_size=8).digest()
    return (int.from_bytes(part) / 2.0**32 for part in (drawn[:4], drawn[4:]))
