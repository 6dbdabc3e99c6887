"""The view in a browser."""

from __future__ import annotations

from pathlib import Path

from coheft.app.cli_base import Port, app


@app.command
def view(what: Path | None = None, *, host: str = "127.0.0.1", port: Port = None) -> None:
    """See a run in the browser: what the robots hold, what they believe, and how it goes on. Ctrl-C ends the view.

    Parameters
    ----------
    what:
        Folder of a run that goes on, if it is not the newest of yours.
    host:
        Who may look: this machine only, unless you name another of its addresses. Whoever can look can also change the
        run.
    port:
        Where the view is; 8010 or the next free one if you name none.
    """
    from coheft.app.view.live import view_run

    view_run(what, host, port, lambda url: print(f"the view is at {url}; Ctrl-C ends it", flush=True))
