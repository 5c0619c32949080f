# SPDX-License-Identifier: Apache-2.0
"""A server of one page on this machine, for whoever knows its address.

It listens on the loopback alone. Other users of the machine, and pages of other sites in the same
browser, can reach that too; so the address holds a secret, and a request has to name this very
host. What it gives is in memory: no path of a request ever becomes the path of a file. Where the
map has its log, the page may ask about it; such a question is a name of its own, and its parameters
are checked by who answers it.
"""

from __future__ import annotations

import hmac
import os
import secrets
import sys
from collections.abc import Callable, Mapping
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from socketserver import TCPServer
from typing import NamedTuple

from oddsmap.errors import InputError, OddsmapError, as_line
from oddsmap.viewer.document import SERVED_POLICY, page_part, served_page
from oddsmap.viewer.questions import LogQuestions, SupersededError

__all__ = ["PageServer"]

_HOST = "127.0.0.1"
_HEADERS = {
    "Content-Security-Policy": SERVED_POLICY,
    "X-Content-Type-Options": "nosniff",
    "X-Frame-Options": "DENY",
    "Referrer-Policy": "no-referrer",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Cross-Origin-Opener-Policy": "same-origin",
    "Cache-Control": "no-store",
}


class _Resource(NamedTuple):
    kind: str
    content: bytes
    status: HTTPStatus = HTTPStatus.OK


def _said(status: HTTPStatus, line: str | None = None) -> _Resource:
    """One line in words."""
    text = f"{line or status.phrase}\n".encode()
    return _Resource("text/plain; charset=utf-8", text, status)


class PageServer(ThreadingHTTPServer):
    """Serves the page of a map; `serve_forever` runs it, `server_close` ends it.

    Args:
        title: of the page.
        payload: see `oddsmap.viewer.payload`.
        port: 0: any that is free.
        journey: of the map's log, see `oddsmap.viewer.journey_payload`; None: without one.
        questions: answers what the page asks about the log.

    Attributes:
        url: where the page is.

    Raises:
        InputError: the port cannot be had.
    """

    daemon_threads = True
    # A port that was left a moment ago is free, but on Windows that would also mean one in use.
    allow_reuse_address = os.name == "posix"

    def __init__(
        self,
        title: str,
        payload: bytes,
        *,
        port: int = 0,
        journey: bytes | None = None,
        questions: LogQuestions | None = None,
    ) -> None:
        try:
            super().__init__((_HOST, port), _Handler)
        except OSError as error:
            raise InputError(
                f"port {port} on {_HOST}: cannot be listened on ({error.strerror or error}); give "
                "another one, or none"
            ) from None
        self._secret = secrets.token_urlsafe(24)
        text = "text/{}; charset=utf-8".format
        page = served_page(title, with_log=journey is not None)
        self._resources: dict[str, _Resource] = {
            "": _Resource(text("html"), page.encode()),
            "viewer.css": _Resource(text("css"), page_part("viewer.css")),
            "viewer.js": _Resource(text("javascript"), page_part("viewer.js")),
            "map.bin": _Resource("application/octet-stream", payload),
        }
        if journey is not None:
            self._resources["log.bin"] = _Resource("application/octet-stream", journey)
        self._questions: Mapping[str, Callable[[str], bytes]] = (
            {} if questions is None else {"why": questions.why, "scan": questions.scan}
        )
        self.url = f"http://{_HOST}:{self.server_port}/{self._secret}/"

    def server_bind(self) -> None:
        """Without asking for the name of the machine, which may take seconds."""
        TCPServer.server_bind(self)
        self.server_name, self.server_port = _HOST, int(self.server_address[1])

    def handle_error(self, request: object, client_address: object) -> None:
        """Say what went wrong here, and nothing where a browser has only gone."""
        if not isinstance(sys.exception(), OSError):
            # Handed on as it came: what kind it is, is the business of the class above.
            super().handle_error(request, client_address)  # type: ignore[arg-type]

    def resource(self, host: str | None, path: str, *, may_ask: bool = True) -> _Resource:
        """What a request gets.

        Args:
            host: its header of that name.
            path: as the request has it; what is not the name of a resource or of a question, letter
                by letter, is none.
            may_ask: whether its method is one for questions.
        """
        # A site whose name is made to lead to this machine sends its own name here.
        if host not in (f"{_HOST}:{self.server_port}", f"localhost:{self.server_port}"):
            return _said(HTTPStatus.MISDIRECTED_REQUEST)
        secret, slash, name = path.removeprefix("/").partition("/")
        known = hmac.compare_digest(secret.encode(), self._secret.encode())
        if not (known and slash):
            return _said(HTTPStatus.NOT_FOUND)
        question, mark, query = name.partition("?")
        if mark and question in self._questions:
            if not may_ask:
                return _said(HTTPStatus.METHOD_NOT_ALLOWED)
            return _answer(self._questions[question], query)
        return self._resources.get(name) or _said(HTTPStatus.NOT_FOUND)


def _answer(ask: Callable[[str], bytes], query: str) -> _Resource:
    """What comes of a question, in any case: the page says what went wrong."""
    try:
        return _Resource("application/json", ask(query))
    except SupersededError:
        return _said(HTTPStatus.CONFLICT, "something else was asked meanwhile")
    except OddsmapError as error:
        return _said(HTTPStatus.BAD_REQUEST, str(error))
    except Exception as error:
        line = as_line(f"unexpected {type(error).__name__}: {error}")
        return _said(HTTPStatus.INTERNAL_SERVER_ERROR, line)


class _Handler(BaseHTTPRequestHandler):
    server: PageServer
    server_version = "oddsmap"
    sys_version = ""
    protocol_version = "HTTP/1.1"
    # A connection that says nothing is closed [s].
    timeout = 30

    def do_GET(self) -> None:
        self._answer(with_content=True)

    def do_HEAD(self) -> None:
        self._answer(with_content=False)

    def _answer(self, *, with_content: bool) -> None:
        host = self.headers.get("Host")
        found = self.server.resource(host, self.path, may_ask=with_content)
        self.send_response(found.status)
        self.send_header("Content-Type", found.kind)
        self.send_header("Content-Length", str(len(found.content)))
        for name, value in _HEADERS.items():
            self.send_header(name, value)
        self.end_headers()
        if with_content:
            try:
                self.wfile.write(found.content)
            except OSError:
                self.close_connection = True  # the page was closed meanwhile, or says nothing

    # `format` is what the class above calls it.
    def log_message(self, format: str, *args: object) -> None:  # noqa: A002
        """Requests are not reported: addresses hold the secret."""
