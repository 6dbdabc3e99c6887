"""The exceptions that coheft raises on purpose."""

from collections.abc import Iterator
from contextlib import contextmanager
from importlib.util import find_spec
from typing import NoReturn

_QUOTED = 400
"""Largest length of quoted text, in characters."""


def one_line(text: str) -> str:
    """Prepare text from elsewhere for logs and terminals: one line, no control characters, limited length."""
    text = text if len(text) <= _QUOTED else f"{text[:_QUOTED]}..."
    return "".join(char if char.isprintable() else repr(char)[1:-1] for char in text)


class CoheftError(Exception):
    """Base class of every error that coheft raises on purpose.

    Its message says what was found, what was expected and what to do; the command line prints it without a
    traceback.
    """


class UsageError(CoheftError):
    """The arguments of a command contradict each other, or have no effect."""


class ScenarioError(CoheftError):
    """A scenario file cannot be used as it is."""


def refuse_scenario(place: str, what: str) -> NoReturn:
    """Raise a ``ScenarioError`` that says where in a scenario it is and what is wrong, which may quote a file."""
    raise ScenarioError(f"{place}: {one_line(what)}")


class MessageError(CoheftError):
    """A message from another process is malformed, of another version, or not what its key promises.

    Its text may quote the message, so it is made fit for a log, see ``one_line``.
    """

    def __init__(self, text: str) -> None:
        super().__init__(one_line(text))


class LoadError(CoheftError):
    """A load change that the payload cannot take was requested."""


class LinkError(CoheftError):
    """A process could not reach another one that it needs, or lost it."""


class SimulationError(CoheftError):
    """The simulated payload has left the valid range of the simulation."""


class MissingPackageError(CoheftError):
    """A request needs a package that is not installed."""

    def __init__(self, package: str, extra: str) -> None:
        super().__init__(
            f"this needs the package '{package}': install 'coheft[{extra}]'; in a clone 'make setup' installs all"
        )


def require_packages(extra: str, *packages: str) -> None:
    """Raise a ``MissingPackageError`` if one of these packages, which an extra installs, is missing."""
    for package in packages:
        if find_spec(package.lower()) is None:
            raise MissingPackageError(package, extra)


class PluginError(CoheftError):
    """A user's estimator or motion cannot be used."""


class RecordingError(CoheftError):
    """A recording does not contain what is required."""


@contextmanager
def file_errors(kind: type[CoheftError], failure: str, advice: str = "") -> Iterator[None]:
    """Raise errors of the file system as another kind: what failed, the system's reason, and what to do."""
    try:
        yield
    except OSError as error:
        raise kind(f"{failure}: {error.strerror or error}{advice}") from error


@contextmanager
def recording_errors(path: object, failure: str = "cannot be read", advice: str = "") -> Iterator[None]:
    """Begin each ``RecordingError`` with the path, once, and raise errors of the file system as such."""
    try:
        yield
    except RecordingError as error:
        begin = f"{path}: "
        raise RecordingError(begin + str(error).removeprefix(begin)) from error
    except OSError as error:
        raise RecordingError(f"{path}: {failure}: {error.strerror or error}{advice}") from error
