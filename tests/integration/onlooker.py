"""Watches a run from wherever it is started, and says in lines of JSON how the server and the agents get on."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import msgspec

from coheft.app.run.folder import RUN_FILE, RunFile
from coheft.wire.messages.structs import Estimate
from coheft.wire.messages.truth import Truth
from coheft.wire.transport.inbox import Inbox, Received
from coheft.wire.transport.planes import guard_observer
from coheft.wire.transport.security import credentials_in
from coheft.wire.transport.sessions import Keys, open_session

EVERY = 10
"""Blocks between two lines of the server; agents tell every few blocks only."""


def main(folder: Path) -> None:
    run = msgspec.json.decode((folder / RUN_FILE).read_bytes(), type=RunFile)
    keys = Keys(run.run)
    credentials = credentials_in(folder / run.keys, "observer") if run.keys is not None else None
    guard = guard_observer(credentials, keys, "observer", run.agents)
    with open_session(connect=[run.server, *run.agents.values()], guard=guard) as session:
        inbox = Inbox()
        inbox.listen(session, "server", {keys.observe_server("truth"): Truth})
        for name in run.agents:
            inbox.listen(session, name, {keys.observe_agent(name, "estimate"): Estimate})
        while True:
            match inbox.receive():
                case Received(name, Estimate() as estimate):
                    seen = {"who": name, "block": estimate.block, "status": estimate.status, "why": estimate.reasons}
                    print(json.dumps(seen), flush=True)
                case Received(name, Truth() as truth) if truth.block % EVERY == 0:
                    print(json.dumps({"who": name, "block": truth.block}), flush=True)


if __name__ == "__main__":
    main(Path(sys.argv[1]))
