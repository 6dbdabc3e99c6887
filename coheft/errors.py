"""The exceptions that coheft raises on purpose."""

from __future__ import annotations


class CoheftError(Exception):
    """Base class of every error that coheft raises on purpose.

    Its message says what was found, what was expected and what to do; the command line prints it without a
    traceback.
    """


class ScenarioError(CoheftError):
    """A scenario file cannot be used as it is."""


class MessageError(CoheftError):
    """A message from another process is malformed, of another version, or not what its key promises."""


class LoadError(CoheftError):
    """A load change was asked for that the payload cannot take."""


class LinkError(CoheftError):
    """A process could not reach, or lost, another one that it needs."""


class SimulationError(CoheftError):
    """The simulated payload left the range in which the simulation means anything."""


class MissingPackageError(CoheftError):
    """Something was asked for that takes a package which is not installed."""

    def __init__(self, package: str, extra: str) -> None:
        super().__init__(f"this needs the package '{package}': install 'coheft[{extra}]'")


class RecordingError(CoheftError):
    """A recording does not hold what is asked of it."""
