"""The view in a browser."""

from __future__ import annotations

from contextlib import suppress

from coheft.app.cli.base import RUN, GivenPath, Port, app


@app.command(group=RUN)
def view(what: GivenPath | None = None, *, host: str = "127.0.0.1", port: Port = None) -> None:
    """See a run, or a recording of one, in the browser. Ctrl-C ends the view.

    Parameters
    ----------
    what:
        A recording that ends with .mcap, or the folder of a run that goes on, if it is not the newest of yours.
    host:
        Who may look: this machine only, unless you name another of its addresses. Whoever can look can also change the
        run.
    port:
        Where the view is; 8010 or the next free one if you name none.
    """

    def tell(url: str) -> None:
        print(f"the view is at {url}; Ctrl-C ends it", flush=True)

    with suppress(KeyboardInterrupt):  # there is no other way to end it
        if what is not None and what.suffix == ".mcap":
            from coheft.app.view.replay import view_recording

            view_recording(what, host, port, tell)
        else:
            from coheft.app.view.live import view_run

            view_run(what, host, port, tell)
