# SPDX-License-Identifier: Apache-2.0
"""The server gives the page of a map to who knows its address on this machine, and no more."""

from __future__ import annotations

import http.client
import json
import socket
import struct
import threading
from collections.abc import Iterator

import pytest

import oddsmap
from oddsmap.errors import InputError
from oddsmap.viewer.document import page_part
from oddsmap.viewer.questions import LogQuestions
from oddsmap.viewer.server import PageServer
from tests.kit import random_scans
from tests.viewer.journey_kit import log_of


@pytest.fixture(scope="module")
def server() -> Iterator[PageServer]:
    with PageServer("a <b> map", b"what a map holds") as made:
        thread = threading.Thread(target=made.serve_forever, kwargs={"poll_interval": 0.01})
        thread.start()
        yield made
        made.shutdown()
        thread.join()


@pytest.fixture(scope="module")
def with_log() -> Iterator[PageServer]:
    log = log_of(random_scans(1, 8))
    questions = LogQuestions(oddsmap.build_map(log, 0.25), log, 8)
    with PageServer("m", b"", journey=b"where it was", questions=questions) as made:
        thread = threading.Thread(target=made.serve_forever, kwargs={"poll_interval": 0.01})
        thread.start()
        yield made
        made.shutdown()
        thread.join()


Answer = tuple[int, http.client.HTTPMessage, bytes]


def ask(
    server: PageServer, path: str, *, host: str | None = "", method: str = "GET", port: int = 0
) -> Answer:
    """What a request gets; host: as that header, "" for the right one, None for none."""
    connection = http.client.HTTPConnection("127.0.0.1", port or server.server_port, timeout=10)
    connection.putrequest(method, path, skip_host=True)
    if host is not None:
        connection.putheader("Host", host or f"127.0.0.1:{server.server_port}")
    connection.endheaders()
    answer = connection.getresponse()
    found = answer.status, answer.headers, answer.read()
    connection.close()
    return found


def secret(server: PageServer) -> str:
    return server.url.rstrip("/").rpartition("/")[2]


def test_the_page_and_what_it_needs(server: PageServer) -> None:
    root = f"/{secret(server)}/"
    status, headers, page = ask(server, root)
    assert (status, headers["Content-Type"]) == (200, "text/html; charset=utf-8")
    assert b"<title>a &lt;b&gt; map - oddsmap</title>" in page
    assert ask(server, f"{root}map.bin")[2] == b"what a map holds"
    for name in ("viewer.css", "viewer.js"):
        status, headers, content = ask(server, root + name)
        assert (status, content) == (200, page_part(name))
        assert headers["Content-Type"].startswith("text/")
    status, headers, content = ask(server, root, method="HEAD")
    assert (status, content, headers["Content-Length"]) == (200, b"", str(len(page)))


def test_a_policy_that_allows_the_page_alone(server: PageServer) -> None:
    _, headers, page = ask(server, f"/{secret(server)}/")
    policy = dict(
        part.strip().partition(" ")[::2] for part in headers["Content-Security-Policy"].split(";")
    )
    assert policy["default-src"] == policy["base-uri"] == policy["form-action"] == "'none'"
    assert policy["script-src"] == policy["style-src"] == policy["connect-src"] == "'self'"
    assert policy["frame-ancestors"] == "'none'"
    assert "unsafe" not in headers["Content-Security-Policy"]
    assert headers["X-Content-Type-Options"] == "nosniff"
    assert headers["Referrer-Policy"] == "no-referrer"
    assert headers["Cross-Origin-Resource-Policy"] == "same-origin"
    assert headers["Cache-Control"] == "no-store"
    assert "Access-Control-Allow-Origin" not in headers
    assert b"default-src 'none'" in page, "also in the page itself"


def test_only_who_knows_the_secret(server: PageServer) -> None:
    known = secret(server)
    assert len(known) >= 32
    wrong = [
        f"/{known[:-1]}/",
        f"/{known}x/map.bin",
        f"/{known.swapcase()}/map.bin",
        f"/?/{known}/",
    ]
    for path in ("/", "/map.bin", "/favicon.ico", f"/{known}", *wrong):
        status, headers, content = ask(server, path)
        assert (status, content) == (404, b"Not Found\n"), path
        assert known not in str(headers)
    with PageServer("m", b"") as other:
        assert secret(other) != known


@pytest.mark.parametrize(
    "name",
    ["../map.bin", "..%2fmap.bin", "%2e%2e/%2e%2e/etc/passwd", "../../../../etc/passwd",
     "page/viewer.js", "./map.bin", "map.bin/", "map.bin?x", "viewer.js/../map.bin", "build.json",
     "/etc/passwd", "..\\map.bin", "MAP.BIN", "map.bin%00"],
)  # fmt: skip
def test_names_are_no_paths(server: PageServer, name: str) -> None:
    assert ask(server, f"/{secret(server)}/{name}")[0] == 404


def test_another_name_of_this_machine_is_refused(server: PageServer) -> None:
    """A site whose name leads to 127.0.0.1 would be of the same origin for a browser."""
    path, port = f"/{secret(server)}/map.bin", server.server_port
    assert ask(server, path, host=f"localhost:{port}")[0] == 200
    for host in (None, "evil.example", f"evil.example:{port}", "127.0.0.1", f"127.0.0.1:{port}0",
                 f"127.0.0.1:{port}.evil.example", f"[::1]:{port}", "localhost"):  # fmt: skip
        assert ask(server, path, host=host)[0] == 421, host


@pytest.mark.parametrize("method", ["POST", "PUT", "DELETE", "OPTIONS", "TRACE"])
def test_nothing_is_taken(server: PageServer, method: str) -> None:
    status, headers, _ = ask(server, f"/{secret(server)}/map.bin", method=method)
    assert status == 501
    assert "Access-Control-Allow-Origin" not in headers


def test_it_listens_on_the_loopback_alone(server: PageServer) -> None:
    assert server.socket.getsockname()[0] == "127.0.0.1"
    assert server.url.startswith(f"http://127.0.0.1:{server.server_port}/")


def test_a_port_in_use(server: PageServer) -> None:
    with pytest.raises(InputError, match=rf"^port {server.server_port} on 127\.0\.0\.1: cannot be"):
        PageServer("m", b"", port=server.server_port)


def test_requests_are_not_reported(server: PageServer, capfd: pytest.CaptureFixture[str]) -> None:
    ask(server, f"/{secret(server)}/")
    ask(server, "/no")
    assert capfd.readouterr() == ("", "")


def test_who_goes_away_is_not_reported(
    server: PageServer, capfd: pytest.CaptureFixture[str]
) -> None:
    with socket.create_connection(("127.0.0.1", server.server_port)) as raw:
        # Closed by a reset, in the middle of a request.
        raw.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
        raw.sendall(b"GET / HT")
    assert ask(server, "/")[0] == 404
    assert capfd.readouterr().err == ""


def test_the_log_is_asked(with_log: PageServer) -> None:
    root = f"/{secret(with_log)}/"
    assert b'data-log="log.bin"' in ask(with_log, root)[2]
    assert ask(with_log, f"{root}log.bin")[2] == b"where it was"
    for query, key in (("why?at=0.5,-0.5", "looked_at"), ("scan?number=7", "returned")):
        status, headers, content = ask(with_log, root + query)
        assert (status, headers["Content-Type"]) == (200, "application/json")
        assert key in json.loads(content)
        assert headers["Cache-Control"] == "no-store"
        assert headers["X-Content-Type-Options"] == "nosniff"


QUESTIONS = ("why?at=0.5,-0.5", "scan?number=1", "log.bin")


@pytest.mark.parametrize("name", QUESTIONS)
def test_who_may_ask(with_log: PageServer, server: PageServer, name: str) -> None:
    known, port = secret(with_log), with_log.server_port
    for path in (f"/{name}", f"/{known[:-1]}/{name}", f"/{known}/{name}/"):
        assert ask(with_log, path)[0] in (400, 404), path
    for host in (None, "evil.example", f"evil.example:{port}"):
        assert ask(with_log, f"/{known}/{name}", host=host)[0] == 421
    assert ask(server, f"/{secret(server)}/{name}")[0] == 404, "there is no log"


@pytest.mark.parametrize("method", ["HEAD", "POST", "PUT", "OPTIONS"])
def test_questions_are_asked_in_one_way(with_log: PageServer, method: str) -> None:
    path = f"/{secret(with_log)}/why?at=0.5,-0.5"
    status, headers, _ = ask(with_log, path, method=method)
    assert status == (405 if method == "HEAD" else 501)
    assert "Access-Control-Allow-Origin" not in headers


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("why?", "at=x,y, in metres"), ("why?at=1", "at=x,y, in metres"),
        ("why?at=1,2,3", "at=x,y, in metres"), ("why?at=nan,nan", "at=x,y, in metres"),
        ("why?at=1%2C2", "at=x,y, in metres"), ("why?at=1,2&at=1,2", "at=x,y, in metres"),
        ("why?at=1,2#x", "at=x,y, in metres"), ("why?at=../map.bin", "at=x,y, in metres"),
        ("why?at=" + "9" * 19 + ",0", "have no cell"), ("why?at=" + "9" * 4000, "at=x,y"),
        ("scan?number=8", "from 0 to 7"), ("scan?number=-1", "from 0 to 7"),
        ("scan?number=" + "9" * 4000, "from 0 to 7"), ("scan?at=1,2", "from 0 to 7"),
    ],
)  # fmt: skip
def test_what_is_asked_is_checked(
    with_log: PageServer, name: str, said: str, capfd: pytest.CaptureFixture[str]
) -> None:
    status, headers, content = ask(with_log, f"/{secret(with_log)}/{name}")
    assert (status, headers["Content-Type"]) == (400, "text/plain; charset=utf-8")
    line = content.decode()
    assert said in line
    assert line.count("\n") == 1
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize(
    "name", ["why", "scan", "WHY?at=1,2", "why%3fat=1,2", "x?at=1,2", "?", "map.bin?at=1,2"]
)
def test_other_questions(with_log: PageServer, name: str) -> None:
    assert ask(with_log, f"/{secret(with_log)}/{name}")[0] == 404


def test_whatever_goes_wrong_is_a_line(
    with_log: PageServer, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    def fail(*_: object, **__: object) -> None:
        raise ValueError("two\nlines")

    monkeypatch.setattr("oddsmap.viewer.questions.why", fail)
    status, _, content = ask(with_log, f"/{secret(with_log)}/why?at=0.5,-0.5")
    assert (status, content) == (500, b"unexpected ValueError: two lines\n")
    assert capfd.readouterr() == ("", "")
