"""A web site of an attacker, and all that its pages can try to get at a view."""

from __future__ import annotations

import http.server
import threading
from collections.abc import Iterator
from contextlib import contextmanager

ATTACK = """async ([port, token, protocol]) => {
    const dial = url => new Promise(done => {
        const socket = new WebSocket(url, [protocol]);
        socket.onopen = () => done(`open ${url}`);
        socket.onmessage = () => done(`a message from ${url}`);
        socket.onerror = () => done("");
    });
    const read = (url, options) => fetch(url, options).then(
        async answer => (answer.ok ? `${answer.status} ` : "") + (await answer.text()).includes("iser"), () => "");
    const frame = url => new Promise(done => {
        const frame = document.createElement("iframe");
        frame.onload = () => {
            try { done(frame.contentDocument.body.innerText.includes("whole address") ? "" : `saw ${url}`); }
            catch { done(""); }
        };
        frame.src = url;
        document.body.append(frame);
    });
    const got = [];
    for (const host of new Set(["127.0.0.1", "localhost", location.hostname]))
        for (const path of ["/", "/a-guess", `/${token}`]) {  // more, and Chromium makes it wait
            const place = `${host}:${port}${path}`;
            got.push(await dial(`ws://${place}`));
            for (const options of [{}, {mode: "no-cors", credentials: "include"}])
                got.push((await read(`http://${place}`, options)).replace("false", ""));
            got.push(await frame(`http://${place}`));
        }
    return got.filter(each => each !== "");
}"""
"""All that a page can try to get at a view; what it got."""


@contextmanager
def hostile_site() -> Iterator[int]:
    """A web server of somebody else on this machine, and its port."""

    class Handler(http.server.BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            seen.append(self.headers.get("Cookie"))
            self.send_response(200)
            self.send_header("Content-Type", "text/html")
            self.end_headers()
            self.wfile.write(b"<!doctype html><title>harmless</title><body>")

        def log_message(self, *_: object) -> None:
            pass

    seen: list[str | None] = []
    with http.server.ThreadingHTTPServer(("127.0.0.1", 0), Handler) as server:
        thread = threading.Thread(target=server.serve_forever)
        thread.start()
        yield server.server_address[1]
        server.shutdown()
        thread.join()
    assert seen
    assert not any(seen), "the view has left a secret where others get it"
