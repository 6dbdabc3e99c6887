"""Folders of runs: where each process's log goes, and the file by which other commands find a run in progress."""

from __future__ import annotations

import contextlib
import os
import shutil
import socket
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import msgspec

from coheft.errors import CoheftError

RUN_FILE = "run.json"
_KEPT = 20
"""How many folders there are among the user's runs at most, not counting runs that go on."""
_FOLDERS = "[0-9]*-[0-9]*-*"  # as ``make_run_folder`` names them; they sort by time


class RunFile(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """How to reach a run; the file exists as long as the run does.

    Attributes:
        run: Prefix of all its keys.
        server: Endpoint at which the server can be observed and asked.
        agents: Endpoint at which each agent can be observed, by name.
        pids: Process ids by name, as far as a supervisor has started them.
        keys: Folder with the credentials of observers and operators, seen from the run's; None: the open profile.
        began: When the run was planned, seconds since 1970.
    """

    run: str
    server: str
    agents: dict[str, str]
    pids: dict[str, int] = {}
    keys: str | None = None
    began: float = 0.0


def runs_folder() -> Path:
    """Where the folders of this user's runs lie, as each platform has it."""
    home = Path.home()
    if sys.platform == "win32":
        base = Path(os.environ.get("LOCALAPPDATA") or home / "AppData" / "Local")
    elif sys.platform == "darwin":
        base = home / "Library" / "Application Support"
    else:
        base = Path(os.environ.get("XDG_STATE_HOME") or home / ".local" / "state")
    return base / "coheft" / "runs"


def make_run_folder(run: str, logs: Path | None = None) -> Path:
    """Make the folder of a new run: ``logs``, or a new one among the user's runs, of which the oldest are removed.

    Raises:
        CoheftError: It cannot be made, or is that of a run in progress, or holds logs already.
    """
    if logs is None:
        _remove_old_folders(_KEPT - 1)
    elif _goes_on(logs):
        raise CoheftError(
            f"a run is in progress in {logs}: name another folder with --logs DIR, or end it: coheft stop"
        )
    elif found := sorted(logs.glob("*.log")) + sorted(logs.glob(RUN_FILE)):
        raise CoheftError(
            f"{found[0]} is there already: the files of a run are never overwritten; name another folder: --logs DIR"
        )
    folder = logs if logs is not None else runs_folder() / f"{time.strftime('%Y%m%d-%H%M%S')}-{run}"
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise CoheftError(
            f"cannot make the folder of the run, {folder}: {error.strerror}; name another: --logs DIR"
        ) from error
    return folder.resolve()


def _remove_old_folders(kept: int) -> None:
    """Remove the folders of all but the user's newest runs; what cannot be removed stays."""
    for folder in sorted(runs_folder().glob(_FOLDERS), reverse=True)[kept:]:
        if not _goes_on(folder):
            shutil.rmtree(folder, ignore_errors=True)


@contextlib.contextmanager
def announced(folder: Path, run_file: RunFile) -> Iterator[None]:
    """Let other commands find the run while the context lasts."""
    announce(folder, run_file)
    try:
        yield
    finally:
        (folder / RUN_FILE).unlink(missing_ok=True)


def announce(folder: Path, run_file: RunFile) -> None:
    """Write the run file, at once or not at all.

    Raises:
        CoheftError: It cannot be written.
    """
    draft = folder / f"{RUN_FILE}.new"
    try:
        folder.mkdir(parents=True, exist_ok=True)  # somebody may have cleaned up while the run goes on
        draft.write_bytes(msgspec.json.format(msgspec.json.encode(run_file)))
        draft.replace(folder / RUN_FILE)
    except OSError as error:
        raise CoheftError(
            f"cannot write {draft}: {error.strerror}; name another folder for the run: --logs DIR"
        ) from error


def find_run(folder: Path | None = None, *, acts: bool = False) -> RunFile:
    """The run in a folder, or else the newest of this user's runs in progress, see ``locate_run``."""
    return locate_run(folder, acts=acts)[1]


def locate_run(folder: Path | None = None, *, acts: bool = False) -> tuple[Path, RunFile]:
    """Like ``find_run``, and the folder in which it is; where it is the newest of several, that is said.

    Of a folder among this user's runs the bare name is enough, if nothing here is called so.

    Args:
        folder: In which it is.
        acts: Whether the run is to be changed: then it has to be named if there are several.

    Raises:
        CoheftError: There is none, or it is not said which.
    """
    if folder is not None:
        if len(folder.parts) == 1 and not folder.exists() and (among_runs := runs_folder() / folder).is_dir():
            folder = among_runs
        run_file = _read(folder)
        if run_file is None or not _answers(run_file.server):
            expected = ": expected the folder of a run, or, for 'coheft view', a recording that ends with .mcap"
            raise CoheftError(f"no run is in progress in {folder}{expected if folder.is_file() else ''}")
        return folder, run_file
    places = [path.parent for path in runs_folder().glob(f"*/{RUN_FILE}")]
    found = [(place, run_file) for place in places if (run_file := _read(place)) and _answers(run_file.server)]
    if not found:
        raise CoheftError(
            "no run is in progress; start one with 'coheft run', or name the folder of a run that has one of its own: "
            "--run DIR"
        )
    newest, *others = sorted(found, key=lambda each: each[1].began, reverse=True)
    if others:
        names = ", ".join(place.name for place, _ in others)
        if acts:
            raise CoheftError(
                f"{len(found)} runs are in progress, and this command changes one of them: name it with --run DIR; "
                f"they are "
                f"{newest[0].name} (the newest), {names}"
            )
        print(
            f"{len(found)} runs are in progress: the newest is {newest[0].name}; others, for --run DIR: {names}",
            file=sys.stderr,
        )
    return newest


def _goes_on(folder: Path) -> bool:
    """Whether the run of a folder does."""
    run_file = _read(folder)
    return run_file is not None and _answers(run_file.server)


def _read(folder: Path) -> RunFile | None:
    """The run file in a folder, its paths seen from here; None if there is none, or only a part."""
    try:
        run_file = msgspec.json.decode((folder / RUN_FILE).read_bytes(), type=RunFile)
    except (OSError, msgspec.DecodeError):
        return None
    keys = str(folder / run_file.keys) if run_file.keys is not None else None
    return msgspec.structs.replace(run_file, keys=keys)


def _answers(endpoint: str) -> bool:
    """Whether somebody listens there. A run that was killed leaves its file behind, so the file alone says nothing."""
    try:
        _dial(endpoint)
    except OSError:
        return False
    return True


def has_gone(run_file: RunFile) -> bool:
    """Whether the system where the server of a run was says that no one listens there; a pulled cable says nothing."""
    try:
        _dial(run_file.server)
    except OSError as error:
        return isinstance(error, ConnectionRefusedError)
    return False


def _dial(endpoint: str) -> None:
    socket.create_connection(split_endpoint(endpoint), timeout=0.5).close()


def split_endpoint(endpoint: str) -> tuple[str, int]:
    """Host and port of an endpoint such as ``tcp/127.0.0.1:20000`` or ``tls/[::1]:20000``."""
    host, _, port = endpoint.partition("/")[2].rpartition(":")
    return host.removeprefix("[").removesuffix("]"), int(port)
