"""Campaigns of many schedules on all cores. Outcomes can be kept in a file, so that a campaign can be continued."""

import hashlib
import os
import time
from collections.abc import Iterator, Sequence
from contextlib import suppress
from pathlib import Path

import msgspec

import coheft
from coheft.app.faults.draw import draw_schedule
from coheft.app.faults.mutants import mutated
from coheft.app.faults.trial import Outcome, try_schedule
from coheft.app.run.parallel import side_by_side, workers
from coheft.errors import CoheftError

_SEEDS, _ROOM = 2**32, 10**6
"""Limits of seeds, and of the number of seeds in a campaign."""


class Header(msgspec.Struct, frozen=True):
    """First line of a file of outcomes: what is the same for all of them, and the seed with which the file began."""

    code: str
    mutant: str = ""
    values: list[str] = []
    first_seed: int = 0


def usual_first_seed(kept: Path | None) -> int:
    """Return the first seed of the campaign that began a file of outcomes.

    If there is no such file, it is one from the clock, so that each campaign runs new schedules.
    """
    if kept is not None:
        with suppress(OSError, msgspec.DecodeError), kept.open("rb") as file:
            return msgspec.json.decode(file.readline(), type=Header).first_seed
    return time.time_ns() // 1_000_000 % (_SEEDS - _ROOM)


class OutcomeFile:
    """A file of outcomes below a ``Header``, one per line, in order of arrival."""

    def __init__(self, path: Path, mutant: str = "", values: Sequence[str] = (), first_seed: int = 0) -> None:
        self._path = path
        self._header = Header(code_hash(), mutant, list(values), first_seed)

    def begin(self) -> list[Outcome]:
        """Return all outcomes in the file; an incomplete last line is removed.

        It raises a ``CoheftError`` if the file cannot be read or written, or is of something else, which is not
        changed.
        """
        try:
            lines = self._path.read_bytes().splitlines(keepends=True) if self._path.exists() else []
            if lines:
                self._check(lines[0])
            if lines and not lines[-1].endswith(b"\n"):
                os.truncate(self._path, sum(map(len, lines[:-1])))
                del lines[-1]
            if not lines:
                self._path.write_bytes(msgspec.json.encode(self._header) + b"\n")
            return [msgspec.json.decode(line, type=Outcome) for line in lines[1:]]
        except OSError as error:
            raise CoheftError(f"cannot keep outcomes in {self._path}: {error.strerror}") from error
        except msgspec.DecodeError as error:
            raise CoheftError(f"{self._path}: damaged, remove it: {error}") from error

    def _check(self, first: bytes) -> None:
        try:
            header = msgspec.json.decode(first, type=Header)
            is_ours = header.code == self._header.code
            if is_ours and (header.mutant, header.values) == (self._header.mutant, self._header.values):
                return
            found = "contains outcomes of another mutant, or of another --set" if is_ours else "is of other code"
        except msgspec.DecodeError:
            found = "is not a file of outcomes"
        raise CoheftError(f"{self._path} {found}: name another file for outcomes, or remove it")

    def append(self, outcome: Outcome) -> None:
        """Append an outcome."""
        with self._path.open("ab") as file:
            file.write(msgspec.json.encode(outcome) + b"\n")


def code_hash() -> str:
    """Return a hash of the package's code."""
    folders = os.walk(Path(coheft.__file__).parent, followlinks=True)  # in a clone, parts of the package are links
    paths = sorted(Path(folder, name) for folder, _, names in folders for name in names if name.endswith(".py"))
    return hashlib.sha256(b"".join(path.read_bytes() for path in paths)).hexdigest()[:16]


def run_campaign(
    seeds: Sequence[int],
    *,
    jobs: int | None = None,
    kept: Path | None = None,
    mutant: str = "",
    values: Sequence[str] = (),
) -> Iterator[Outcome]:
    """Run one schedule per seed; yield all outcomes as they arrive.

    Outcomes are appended to the file ``kept``, and schedules whose outcome it contains are not run again: these come
    first. See ``workers``, ``mutants`` and ``draw_schedule``.

    Raises:
        MissingPackageError: A package that campaigns need is not installed.
        CoheftError: The file cannot be read or written, or contains something else.
    """
    file = None if kept is None else OutcomeFile(kept, mutant, values, min(seeds))
    left = dict.fromkeys(seeds)
    with workers(jobs):
        for outcome in [] if file is None else file.begin():
            if outcome.seed in left:
                del left[outcome.seed]
                yield outcome
        for outcome in side_by_side(try_seed, ((seed, mutant, tuple(values)) for seed in left)):
            if file is not None:
                file.append(outcome)
            yield outcome


def try_seed(seed: int, mutant: str = "", values: Sequence[str] = ()) -> Outcome:
    """Run the schedule of a seed, with a deliberate bug if one is named."""
    with mutated(mutant):
        return try_schedule(draw_schedule(seed, values=values))
