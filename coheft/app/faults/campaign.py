"""Many schedules over all cores. What is done is kept in a file, so that a campaign can be cut off and go on."""

from __future__ import annotations

import hashlib
import os
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

import msgspec

import coheft
from coheft.app.faults.draw import draw_schedule
from coheft.app.faults.mutants import mutated
from coheft.app.faults.trial import Outcome, try_schedule
from coheft.app.run.parallel import side_by_side, workers
from coheft.errors import CoheftError

_SEEDS, _ROOM = 2**32, 10**6
"""Seeds are smaller, and a campaign has no more of them than that."""
_LINKED = ("agents", "consensus", "physics_server")
"""Parts of the package that are folders of their own in a clone, which ``rglob`` does not follow."""


class Header(msgspec.Struct, frozen=True):
    """First line of a file of outcomes: they belong to this code, to agents with this bug, and to these values.

    Attributes:
        code: Hash of the code.
        mutant: The deliberate bug, if any.
        values: Keys of the scenarios that were not drawn.
        first_seed: Of the campaign that began the file.
    """

    code: str
    mutant: str = ""
    values: list[str] = []
    first_seed: int = 0


def new_first_seed() -> int:
    """By the clock: each campaign tries what none has tried before."""
    return time.time_ns() // 1_000_000 % (_SEEDS - _ROOM)


def kept_first_seed(path: Path) -> int | None:
    """First seed of the campaign that began a file of outcomes; None if there is none, or no such file."""
    try:
        with path.open("rb") as file:
            return msgspec.json.decode(file.readline(), type=Header).first_seed
    except (OSError, msgspec.DecodeError):
        return None


class OutcomeFile:
    """Outcomes, one a line, in the order in which they came.

    Args:
        path: The file.
        mutant: The deliberate bug, if any.
        values: Keys of the scenarios that were not drawn.
        first_seed: For a file that is not there yet.
    """

    def __init__(self, path: Path, mutant: str = "", values: Sequence[str] = (), first_seed: int = 0) -> None:
        self._path = path
        self._header = Header(code_hash(), mutant, list(values), first_seed)

    def begin(self) -> list[Outcome]:
        """What has been kept so far, of whatever seeds; a line that was not written to its end is cut off.

        Raises:
            CoheftError: The file cannot be read or written, or is of other code, or something else: it stays as it is.
        """
        try:
            lines = self._path.read_bytes().splitlines(keepends=True) if self._path.exists() else []
            if not lines:
                self._path.write_bytes(_line(self._header))
                return []
            self._check(lines[0])
            outcomes = list(_decoded(lines[1:]))
            os.truncate(self._path, sum(map(len, lines[: 1 + len(outcomes)])))
        except OSError as error:
            raise CoheftError(f"cannot keep outcomes in {self._path}: {error.strerror}") from error
        return outcomes

    def _check(self, first: bytes) -> None:
        try:
            header = msgspec.json.decode(first, type=Header)
            is_ours = header.code == self._header.code
            if is_ours and (header.mutant, header.values) == (self._header.mutant, self._header.values):
                return
            found = "holds outcomes of another mutant, or of another --set" if is_ours else "is of other code"
        except msgspec.DecodeError:
            found = "holds no outcomes"
        raise CoheftError(f"{self._path} {found}: name another file to keep outcomes in, or remove it")

    def append(self, outcome: Outcome) -> None:
        """Keep one more."""
        with self._path.open("ab") as file:
            file.write(_line(outcome))


def _line(part: Header | Outcome) -> bytes:
    return msgspec.json.encode(part) + b"\n"


def _decoded(lines: Sequence[bytes]) -> Iterator[Outcome]:
    """Outcomes up to the first line that was not written to its end."""
    for line in lines:
        if not line.endswith(b"\n"):
            return
        try:
            yield msgspec.json.decode(line, type=Outcome)
        except msgspec.DecodeError:
            return


def code_hash() -> str:
    """What tells one state of the code from another."""
    package = Path(coheft.__file__).parent
    folders = [package, *((package / name).resolve() for name in _LINKED)]
    digest = hashlib.sha256()
    for path in sorted({path.resolve() for folder in folders for path in folder.rglob("*.py")}):
        digest.update(path.read_bytes())
    return digest.hexdigest()[:16]


def run_campaign(
    seeds: Sequence[int],
    *,
    jobs: int | None = None,
    kept: Path | None = None,
    mutant: str = "",
    values: Sequence[str] = (),
    on_outcome: Callable[[Outcome], None] = lambda outcome: None,
) -> list[Outcome]:
    """Try one schedule per seed.

    Args:
        seeds: Of the schedules.
        jobs: Number of processes; None for one per core.
        kept: File to which outcomes are added as they come; those that are there already are not tried again.
        mutant: A deliberate bug to put into the agents, see ``mutants``.
        values: Keys of the scenarios that are not drawn, see ``draw_schedule``.
        on_outcome: Told every outcome, those that were kept first.

    Returns:
        All outcomes, in the order of seeds.

    Raises:
        MissingPackageError: A package that campaigns need is not installed.
        CoheftError: The file cannot be read or written, or holds something else.
    """
    file = None if kept is None else OutcomeFile(kept, mutant, values, min(seeds))
    outcomes: dict[int, Outcome] = {}
    with workers(jobs):
        if file is not None:
            wanted = set(seeds)
            outcomes = {outcome.seed: outcome for outcome in file.begin() if outcome.seed in wanted}
        for outcome in outcomes.values():
            on_outcome(outcome)
        left = [seed for seed in seeds if seed not in outcomes]
        for outcome in side_by_side(try_seed, ((seed, mutant, tuple(values)) for seed in left)):
            outcomes[outcome.seed] = outcome
            if file is not None:
                file.append(outcome)
            on_outcome(outcome)
    return [outcomes[seed] for seed in seeds]


def try_seed(seed: int, mutant: str = "", values: Sequence[str] = ()) -> Outcome:
    """Try the schedule of a seed, with a deliberate bug if one is named."""
    with mutated(mutant):
        return try_schedule(draw_schedule(seed, values=values))
