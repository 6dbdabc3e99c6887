"""Folders of runs, which hold the logs of processes and the file with which other commands find a run in progress."""

import contextlib
import os
import shutil
import socket
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import msgspec

from coheft.errors import CoheftError, file_errors

RUN_FILE = "run.json"
END_FILE = "end.json"
_KEPT = 20
"""Largest number of folders among the user's runs, apart from runs in progress."""
_FOLDERS = "[0-9]*-[0-9]*-*"  # as ``make_run_folder`` names them; they sort by time


class RunFile(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Addresses of a run in progress; the file exists as long as the run.

    Attributes:
        pids: Process ids by name, of processes that a supervisor has started.
        keys: Folder with the credentials of observers and operators, relative to the run's folder; None for the open
            profile.
        began: Time at which the run was planned, in seconds since 1970.
    """

    run: str
    server: str
    agents: dict[str, str]
    pids: dict[str, int] = {}
    keys: str | None = None
    began: float = 0.0


def runs_folder() -> Path:
    """Return the folder of this user's runs, at the platform's usual place, or raise a ``CoheftError``."""
    if sys.platform == "darwin":
        base = "~/Library/Application Support"
    else:
        base = os.environ.get("XDG_STATE_HOME") or "~/.local/state"
    try:
        return Path(base).expanduser() / "coheft" / "runs"
    except RuntimeError as error:
        raise CoheftError(
            "this user has no home folder for runs: name a folder with --logs DIR or --run DIR"
        ) from error


def make_run_folder(run: str, logs: Path | None = None) -> Path:
    """Make the folder of a new run: ``logs``, or a new one among the user's runs, of which the oldest are removed.

    ``logs`` that hold logs already, or belong to a run in progress, are a ``CoheftError``.
    """
    if logs is None:
        for old in sorted(runs_folder().glob(_FOLDERS), reverse=True)[_KEPT - 1 :]:
            if old.is_symlink():
                if _running(old) is None:
                    old.unlink(missing_ok=True)
            elif _running(old) is None:
                shutil.rmtree(old, ignore_errors=True)
    elif _running(logs) is not None:
        raise CoheftError(
            f"a run is in progress in {logs}: name another folder with --logs DIR, or end it: coheft stop"
        )
    elif found := sorted(logs.glob("*.log")) + sorted(logs.glob(RUN_FILE)):
        raise CoheftError(
            f"{found[0]} exists already: the files of a run are never overwritten; name another folder: --logs DIR"
        )
    folder = logs if logs is not None else runs_folder() / _folder_name(run)
    with file_errors(CoheftError, f"cannot make the folder of the run, {folder}", "; name another: --logs DIR"):
        folder.mkdir(parents=True, exist_ok=True)
    return folder.resolve()


def _folder_name(run: str) -> str:
    return f"{time.strftime('%Y%m%d-%H%M%S')}-{run}"


@contextlib.contextmanager
def announced(folder: Path, run_file: RunFile) -> Iterator[None]:
    """Let other commands find the run while the context lasts; to a folder elsewhere, there is a link meanwhile."""
    (folder / END_FILE).unlink(missing_ok=True)
    announce(folder, run_file)
    link: Path | None = None
    with contextlib.suppress(OSError, CoheftError):  # no place for links: --run still finds the run
        if folder.parent.resolve() != (runs := runs_folder()).resolve():
            runs.mkdir(parents=True, exist_ok=True)
            (link := runs / _folder_name(run_file.run)).symlink_to(folder, target_is_directory=True)
    try:
        yield
    finally:
        (folder / RUN_FILE).unlink(missing_ok=True)
        if link is not None:
            link.unlink(missing_ok=True)


def announce(folder: Path, run_file: RunFile) -> None:
    """Write the run file atomically, or raise a ``CoheftError``."""
    _write(folder / RUN_FILE, run_file)


def note_end(folder: Path, time: float) -> None:
    """Write down when a run has ended [s] that was not aborted, atomically, or raise a ``CoheftError``.

    This stays in the run's folder, for those that have missed the server's last message.
    """
    _write(folder / END_FILE, {"time": time})


def noted_end(folder: Path) -> float | None:
    """Return when the run in a folder has ended [s]; None if it goes on, or was aborted."""
    try:
        return msgspec.json.decode((folder / END_FILE).read_bytes(), type=dict[str, float])["time"]
    except (OSError, msgspec.DecodeError, KeyError):
        return None


def _write(file: Path, content: object) -> None:
    folder, draft = file.parent, file.with_name(f"{file.name}.new")
    with file_errors(CoheftError, f"cannot write {draft}", "; name another folder for the run: --logs DIR"):
        folder.mkdir(parents=True, exist_ok=True)  # it may have been removed during the run
        draft.write_bytes(msgspec.json.format(msgspec.json.encode(content)))
        draft.replace(file)


def find_run(folder: Path | None = None, *, acts: bool = False) -> RunFile:
    """Return the run in a folder, or else the newest of this user's runs in progress, see ``locate_run``."""
    return locate_run(folder, acts=acts)[1]


def locate_run(folder: Path | None, *, acts: bool = False) -> tuple[Path, RunFile]:
    """Return a run in progress and its folder. If it is the newest of several, print that to stderr.

    A folder among this user's runs can be given by its bare name, unless a folder of that name exists here. For a
    command that ``acts``, which changes the run, the folder is required if there are several. A ``CoheftError`` says
    that there is no such run, or that it is not clear which one is meant.
    """
    if folder is not None:
        if len(folder.parts) == 1 and not folder.exists() and (among_runs := runs_folder() / folder).is_dir():
            folder = among_runs
        run_file = _running(folder)
        if run_file is None:
            expected = ": expected the folder of a run, or, for 'coheft view', a recording that ends with .mcap"
            raise CoheftError(f"no run is in progress in {folder}{expected if folder.is_file() else ''}")
        return folder, run_file
    found = runs_in_progress()
    if not found:
        raise CoheftError(
            "no run is in progress; start one with 'coheft run', or name the folder of another run: --run DIR"
        )
    newest, *others = found
    if others:
        names = ", ".join(place.name for place, _ in others)
        if acts:
            raise CoheftError(
                f"{len(found)} runs are in progress, and this command changes one of them: name it with --run DIR; "
                f"available: {newest[0].name} (the newest), {names}"
            )
        print(
            f"{len(found)} runs are in progress: the newest is {newest[0].name}; others, for --run DIR: {names}",
            file=sys.stderr,
        )
    return newest


def runs_in_progress() -> list[tuple[Path, RunFile]]:
    """Return the folders among this user's runs whose runs are in progress, the newest first."""
    places = [path.parent for path in runs_folder().glob(f"*/{RUN_FILE}")]
    found = [(place, run_file) for place in places if (run_file := _running(place)) is not None]
    return sorted(found, key=lambda each: each[1].began, reverse=True)


def _running(folder: Path) -> RunFile | None:
    """Return the run file of a folder whose run is in progress, with absolute paths.

    A killed run leaves its file behind, so the file alone proves nothing.
    """
    try:
        run_file = msgspec.json.decode((folder / RUN_FILE).read_bytes(), type=RunFile)
    except (OSError, msgspec.DecodeError):
        return None
    keys = str(folder / run_file.keys) if run_file.keys is not None else None
    return msgspec.structs.replace(run_file, keys=keys) if _dial(run_file.server) is None else None


def has_gone(run_file: RunFile) -> bool:
    """Whether the server's host reports that no process listens at its endpoint; a broken connection proves nothing."""
    return isinstance(_dial(run_file.server), ConnectionRefusedError)


def _dial(endpoint: str) -> OSError | None:
    """Return why an endpoint cannot be dialled; None if a process listens there."""
    try:
        socket.create_connection(split_endpoint(endpoint), timeout=0.5).close()
    except OSError as error:
        return error
    return None


def split_endpoint(endpoint: str) -> tuple[str, int]:
    """Return host and port of an endpoint such as ``tcp/127.0.0.1:20000`` or ``tls/[::1]:20000``."""
    host, _, port = endpoint.partition("/")[2].rpartition(":")
    return host.removeprefix("[").removesuffix("]"), int(port)
