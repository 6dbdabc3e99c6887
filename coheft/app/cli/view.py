"""The command that shows a run in a browser."""

from contextlib import suppress
from typing import Annotated

from cyclopts import Parameter

from coheft.app.cli import options
from coheft.app.cli.base import RUN, app


@app.command(group=RUN)
def view(
    what: Annotated[options.GivenPath | None, Parameter(name=("--what", "--run"))] = None,
    *,
    host: str = "127.0.0.1",
    port: options.Port = None,
    read_only: options.Flag = False,
) -> None:
    """Show a run, or a recording of one, in the browser. Ctrl-C ends the view.

    Args:
        what: A recording that ends with .mcap, or the folder of a run in progress; by default your newest run.
        host: Address to listen on; by default only this machine can connect. Anyone who has the printed address, secret
            included, can watch and control the run.
        port: Port to listen on; by default 8010 or the next free one.
        read_only: Read-only: without buttons.
    """
    from coheft.app.view.place import Place

    place = Place.choose(host, port)

    def shown() -> None:
        print(f"The view is at {place.url} (Ctrl-C ends it)", flush=True)

    with suppress(KeyboardInterrupt):  # the only way to end it
        if what is not None and what.suffix == ".mcap":
            from coheft.app.view.replay import view_recording

            view_recording(what, place, shown)
        else:
            from coheft.app.view.live import view_run

            view_run(what, place, shown, read_only=read_only)
