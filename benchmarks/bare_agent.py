"""An agent's process without mathematics: the same shell, links and messages. See ``benchmarks.floor``."""

from __future__ import annotations

from unittest.mock import patch

from benchmarks.replay import BareAgent
from coheft.agents.process import main as process

if __name__ == "__main__":
    with patch.object(process, "Agent", BareAgent):
        process.main()
