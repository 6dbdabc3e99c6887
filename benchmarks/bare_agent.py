"""An agent's process without mathematics, with the same links and messages, see ``benchmarks.floor``."""

from unittest.mock import patch

from benchmarks.replay import BareAgent
from coheft.agents.process import main as process

if __name__ == "__main__":
    with patch.object(process, "Agent", BareAgent):
        process.main()
