"""A process that imports what all processes of a run need, and forks them, so that it is imported once.

It is a new process, not the user's own, which may have threads, open sessions and other state that does not survive a
fork: it only imports and forks. A forked process is equivalent to ``python -m module``, in a session of its own, with
its own log; the client holds the other end of its stdin. The fork server reports how it ended.

Where systems cannot fork (or not so that libraries survive it, as on macOS), and where ``COHEFT_SPAWN`` is set for
debugging, each process is started from scratch.
"""

from __future__ import annotations

import ctypes
import gc
import importlib
import os
import select
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Mapping, Sequence
from contextlib import suppress

_PACKET = 4096
_SET_NAME = 15
"""``PR_SET_NAME`` of ``prctl``: sets the name of a thread, which ``top`` shows."""


def can_fork() -> bool:
    """Whether a fork server can be used."""
    return sys.platform == "linux" and not os.environ.get("COHEFT_SPAWN")


class Forked:
    """A process of a fork server, with a part of the interface of ``subprocess.Popen``.

    ``returncode`` is its exit status, or minus the number of a signal; None while it runs.
    """

    def __init__(self, fork_server: ForkServer, pid: int, stdin: int) -> None:
        self._fork_server = fork_server
        self.pid = pid
        self.stdin = os.fdopen(stdin, "wb")
        self.returncode: int | None = None

    def poll(self) -> int | None:
        """Return the exit status, None while the process runs."""
        self._fork_server.take_in(0.0)
        return self.returncode

    def wait(self, timeout: float | None = None) -> int:
        """Wait for the end of the process and return its exit status; ``TimeoutExpired`` after so many seconds."""
        deadline = None if timeout is None else time.monotonic() + timeout
        while self.returncode is None:
            left = None if deadline is None else deadline - time.monotonic()
            if timeout is not None and left is not None and left <= 0.0:
                raise subprocess.TimeoutExpired(f"process {self.pid}", timeout)
            self._fork_server.take_in(left)
        return self.returncode

    def send_signal(self, number: int) -> None:
        """Send a signal, if the process still runs."""
        if self.poll() is None:
            with suppress(ProcessLookupError):
                os.kill(self.pid, number)

    def terminate(self) -> None:
        """Ask the process to end, by SIGTERM."""
        self.send_signal(signal.SIGTERM)

    def kill(self) -> None:
        """End the process, by SIGKILL."""
        self.send_signal(signal.SIGKILL)


class ForkServer:
    """Starts the process that imports in the background, and asks it to fork.

    Each of the modules that can be forked has a function ``main`` without arguments.
    """

    def __init__(self, modules: Sequence[str], environment: Mapping[str, str]) -> None:
        self.modules = tuple(modules)
        self._children: dict[int, Forked] = {}
        self._newest: Forked | None = None
        self._is_there = True
        self._process: subprocess.Popen[bytes] | None = None
        self._socket, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        with theirs:
            self._process = subprocess.Popen(
                [sys.executable, "-m", __name__, str(theirs.fileno()), *modules],
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL,
                stderr=subprocess.DEVNULL,  # if a module cannot be imported, starting it from scratch reports that
                env=dict(environment),
                pass_fds=[theirs.fileno()],
                start_new_session=True,
            )

    def start(self, name: str, module: str, log: int) -> Forked | None:
        """Fork a process, named so in ``top``, when all modules are imported; None if the fork server is gone.

        It runs ``main`` of a module, with its output to the open file ``log``.
        """
        theirs, self._stdin = os.pipe()
        self._newest = None
        try:
            socket.send_fds(self._socket, [f"{module} {name}".encode()], [theirs, log])
            while self._newest is None and self._is_there:
                self.take_in(None)
        except OSError:
            self._handle_loss()
        finally:
            os.close(theirs)
        if self._newest is None:
            os.close(self._stdin)
        return self._newest

    def take_in(self, timeout: float | None) -> None:
        """Process reports of the fork server, waiting up to ``timeout`` [s] for the first (None: without limit)."""
        while self._is_there and select.select([self._socket], [], [], timeout)[0]:
            timeout = 0.0
            try:
                words = self._socket.recv(_PACKET).split()
            except OSError:
                words = []
            if not words:
                self._handle_loss()
            elif words[0] == b"started":
                pid = int(words[1])
                self._newest = self._children[pid] = Forked(self, pid, self._stdin)
            else:
                child = self._children.pop(int(words[1]), None)
                if child is not None:
                    child.returncode = int(words[2])

    def _handle_loss(self) -> None:
        """Kill the remaining processes when the fork server is gone, as no other process could report how they end."""
        self._is_there = False
        for child in self._children.values():
            with suppress(ProcessLookupError):
                os.kill(child.pid, signal.SIGKILL)
            child.returncode = -signal.SIGKILL
        self._children.clear()

    def __del__(self) -> None:
        self.close()  # also if no run has begun

    def close(self) -> None:
        """End the fork server; its processes continue."""
        self._is_there = False
        self._socket.close()
        if self._process is not None:  # otherwise Ctrl-C came before it was started
            self._process.kill()  # it may still be importing, which takes long on a busy machine
            self._process.wait()


def _main() -> None:
    """Import, then fork on request, and report processes that have ended, until the client is gone."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    asks = socket.socket(fileno=int(sys.argv[1]))
    mains = {name: importlib.import_module(name).main for name in sys.argv[2:]}
    gc.collect()
    gc.freeze()  # keeps memory shared: the collector would write to all of it
    woken, wakes = socket.socketpair()
    wakes.setblocking(False)
    signal.signal(signal.SIGCHLD, lambda *_: None)
    signal.set_wakeup_fd(wakes.fileno(), warn_on_full_buffer=False)
    while True:
        ready, _, _ = select.select([asks, woken], [], [])
        if woken in ready:
            woken.recv(_PACKET)
            _report_ends(asks)
        if asks in ready:
            request, files, _, _ = socket.recv_fds(asks, _PACKET, 2)
            if not request:
                return
            module, name = request.decode().split(" ", 1)
            pid = os.fork()
            if pid == 0:
                signal.set_wakeup_fd(-1)
                signal.signal(signal.SIGCHLD, signal.SIG_DFL)
                for each in (asks, woken, wakes):
                    each.close()
                _detach(name, *files)
                mains[module]()
                return
            for file in files:
                os.close(file)
            asks.send(f"started {pid}".encode())


def _report_ends(asks: socket.socket) -> None:
    with suppress(ChildProcessError):
        while (ended := os.waitpid(-1, os.WNOHANG))[0]:
            asks.send(f"ended {ended[0]} {os.waitstatus_to_exitcode(ended[1])}".encode())


def _detach(name: str, stdin: int, log: int) -> None:
    """Turn this newly forked process into an independent one."""
    os.setsid()
    for file, number in ((stdin, 0), (log, 1), (log, 2)):
        os.dup2(file, number)
    os.close(stdin)
    os.close(log)
    with suppress(AttributeError, OSError):
        ctypes.CDLL(None).prctl(_SET_NAME, name.encode(), 0, 0, 0)


if __name__ == "__main__":
    _main()
