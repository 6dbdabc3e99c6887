"""The view in a browser."""

from __future__ import annotations

from contextlib import suppress

from coheft.app.cli.base import RUN, Flag, GivenPath, Port, app


@app.command(group=RUN)
def view(what: GivenPath | None = None, *, host: str = "127.0.0.1", port: Port = None, read_only: Flag = False) -> None:
    """See a run, or a recording of one, in the browser. Ctrl-C ends the view.

    Parameters
    ----------
    what:
        A recording that ends with .mcap, or the folder of a run that goes on, if it is not the newest of yours.
    host:
        Where it listens: for this machine only, unless you name another of its addresses. Who has the address that is
        printed, secret included, can look and act.
    port:
        Where the view is; 8010 or the next free one if you name none.
    read_only:
        Show, but do not act: no buttons.
    """
    from coheft.app.view.door import Door

    def tell(url: str) -> None:
        print(f"The view is at {url} (Ctrl-C ends it)", flush=True)

    with suppress(KeyboardInterrupt):  # there is no other way to end it
        if what is not None and what.suffix == ".mcap":
            from coheft.app.view.replay import view_recording

            view_recording(what, Door(host), port, tell)
        else:
            from coheft.app.view.live import view_run

            view_run(what, Door(host), port, tell, read_only=read_only)
