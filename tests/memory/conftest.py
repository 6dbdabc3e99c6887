"""What all tests of memories are about."""

from __future__ import annotations

import pytest

from coheft.wire.config import AgentConfig
from tests.estimation.team import Team
from tests.memory.memories import held_team, own_config


@pytest.fixture(scope="module")
def team() -> Team:
    return held_team()


@pytest.fixture(scope="module")
def config() -> AgentConfig:
    return own_config()
