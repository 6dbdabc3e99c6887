"""States that messages report: of an agent's estimate, and of a run."""

from enum import StrEnum


class Validity(StrEnum):
    """Whether an agent's estimate may be relied upon."""

    STARTING = "starting"
    """There is no estimate of the payload yet."""
    VALID = "valid"
    """The truth is within five of the estimate's own standard deviations."""
    STALE = "stale"
    """The agent cannot know whether its last valid estimate still holds."""


class RunState(StrEnum):
    """What the server of a run does."""

    WAITING = "waiting"
    """It waits for all robots."""
    RUNNING = "running"
    PAUSED = "paused"
    FINISHED = "finished"
    """It simulates no further block, and has stopped the robots."""
