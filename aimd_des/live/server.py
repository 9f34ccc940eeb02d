"""The server of the page: it listens on this machine only, and knows a page by the token in its address."""

import asyncio
import hmac
import json
import logging
import secrets
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from importlib.util import find_spec
from typing import TYPE_CHECKING, Any

from aimd_des.live.html_page import controls, description, policy, render
from aimd_des.live.session import Session
from aimd_des.scenario import Scenario
from aimd_des.utils.errors import InputError

if TYPE_CHECKING:
    import tornado.web

_ADDRESS = "127.0.0.1"
# A wish of a page is short; what is longer is none.
_LONGEST = 1 << 20
# Two systems side by side, and what is measured of them.
_THREADS = 3


def check_server() -> None:
    """Refuse to serve where the library for it is missing."""
    if find_spec("tornado") is None:
        remedy = "say pip install 'aimd-des[live]', or --export for a page that needs no server"
        raise InputError(f"a live page needs tornado, which is not installed; {remedy}")


def serve(base: Scenario, port: int, told: Callable[[str], None]) -> None:
    """Serve the page until Ctrl-C; its address is told as soon as it can be opened."""
    with suppress(KeyboardInterrupt):
        asyncio.run(_serve(base, port, told))


async def _serve(base: Scenario, port: int, told: Callable[[str], None]) -> None:
    from tornado.httpserver import HTTPServer
    from tornado.netutil import bind_sockets

    try:
        sockets = bind_sockets(port, _ADDRESS)
    except OSError as failure:
        remedy = "choose another, or leave --port out for any that is free"
        raise InputError.of("port", port, f"one that is free ({failure.strerror})", remedy) from None
    token = secrets.token_urlsafe(24)
    where = sockets[0].getsockname()[1]
    with ThreadPoolExecutor(_THREADS) as pool:
        server = HTTPServer(application(base, token, where, pool))
        server.add_sockets(sockets)
        told(f"http://{_ADDRESS}:{where}/?token={token}")
        try:
            await asyncio.Event().wait()
        finally:
            server.stop()
            pool.shutdown(wait=False, cancel_futures=True)


def application(base: Scenario, token: str, port: int, pool: ThreadPoolExecutor) -> "tornado.web.Application":
    """Put the server together; nothing is told without the token."""
    import tornado.web
    import tornado.websocket

    # Refused requests would be logged with the token in them.
    logging.getLogger("tornado.access").disabled = True
    hosts = {f"{name}:{port}" for name in (_ADDRESS, "localhost")}
    boot = {"mode": "live", "controls": controls(), "start": description(base, base)}

    class Guarded(tornado.web.RequestHandler):
        def prepare(self) -> None:
            """Refuse requests under another name of this machine, or without the token."""
            given = self.get_query_argument("token", "")
            known = hmac.compare_digest(given.encode(), token.encode())
            if self.request.host not in hosts or not known:
                raise tornado.web.HTTPError(403)

    class Page(Guarded):
        def get(self) -> None:
            """Hand out the page."""
            connect = f"ws://{self.request.host}"
            self.set_header("Content-Security-Policy", f"{policy(connect)}; frame-ancestors 'none'")
            self.set_header("Referrer-Policy", "no-referrer")
            self.set_header("X-Content-Type-Options", "nosniff")
            self.set_header("Cache-Control", "no-store")
            self.set_header("Cross-Origin-Opener-Policy", "same-origin")
            self.write(render(boot, connect=connect))

    class Socket(Guarded, tornado.websocket.WebSocketHandler):
        session: Session | None = None

        def check_origin(self, origin: str) -> bool:
            """Let pages of other sites ask for nothing."""
            return origin in {f"http://{host}" for host in hosts}

        def open(self, *_: str, **__: str) -> None:
            """Begin to play."""
            self.set_nodelay(True)
            self.session = Session(base, pool, self._tell)

        def on_message(self, message: str | bytes) -> None:
            """Do what the page asks for."""
            assert self.session is not None  # noqa: S101 - open
            try:
                self.session.take(message if isinstance(message, str) else "")
            except InputError as refusal:
                self._tell(json.dumps({"kind": "refused", "text": str(refusal)}))

        def on_close(self) -> None:
            """Compute nothing more for a page that is gone."""
            if self.session is not None:
                self.session.stop()

        def _tell(self, message: str | bytes) -> None:
            with suppress(tornado.websocket.WebSocketClosedError):
                self.write_message(message, binary=isinstance(message, bytes))

    settings: dict[str, Any] = {"websocket_max_message_size": _LONGEST, "default_handler_class": Guarded}
    return tornado.web.Application([("/", Page), ("/socket", Socket)], **settings)
