# SPDX-License-Identifier: Apache-2.0
"""The page as HTML: one file that holds everything, or one that asks a server for the rest.

The program of the page is built from `web/` and lies in `page/`. A Content-Security-Policy allows
it and nothing else: no other script, no style, and no address but that of the server.
"""

from __future__ import annotations

import base64
import hashlib
import html
from importlib.resources import files

from oddsmap.viewer.text import text_of

__all__ = ["SERVED_POLICY", "page_part", "served_page", "single_page"]

# An empty icon stands in the page, so that no browser asks for one.
_COMMON = "default-src 'none'; img-src data:; base-uri 'none'; form-action 'none'"

SERVED_POLICY = (
    f"{_COMMON}; script-src 'self'; style-src 'self'; connect-src 'self'; frame-ancestors 'none'"
)
"""The policy of the page that a server gives, as a header."""

_PAGE = """<!doctype html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta http-equiv="Content-Security-Policy" content="{policy}">
<meta name="viewport" content="width=device-width, initial-scale=1">
<meta name="referrer" content="no-referrer">
<link rel="icon" href="data:,">
<title>{title}</title>
{style}
</head>
<body>
<main id="viewer" class="oddsmap" data-theme="auto"{log}>
<p class="failure">The map is being loaded.</p>
</main>
<noscript>The map is drawn by JavaScript, which is switched off.</noscript>
{data}{script}
</body>
</html>
"""


def page_part(name: str) -> bytes:
    """A file of the page as it was built: "viewer.js" or "viewer.css"."""
    return files("oddsmap.viewer").joinpath("page", name).read_bytes()


def served_page(title: str, *, with_log: bool = False) -> str:
    """The page of a server, which also gives `viewer.js`, `viewer.css` and `map.bin` beside it.

    Args:
        title: of the window.
        with_log: whether it gives `log.bin`, too.
    """
    # What only a header can say is left to it.
    policy = SERVED_POLICY.removesuffix("; frame-ancestors 'none'")
    return _filled(
        title,
        policy=policy,
        style='<link rel="stylesheet" href="viewer.css">',
        script='<script src="viewer.js"></script>',
        log=' data-log="log.bin"' if with_log else "",
    )


def single_page(title: str, payload: bytes, journey: bytes | None = None) -> str:
    """One file that works from the disk, with the network off.

    Args:
        title: of the window.
        payload: see `oddsmap.viewer.payload`.
        journey: of the map's log, see `oddsmap.viewer.journey_payload`; None: without one.
    """
    style, script = (page_part(f"viewer.{kind}").decode() for kind in ("css", "js"))
    # The end of an element is looked for in its text, whatever else that is.
    script = script.replace("</script", "<\\/script")
    return _filled(
        title,
        policy=f"{_COMMON}; script-src {_hash(script)}; style-src {_hash(style)}",
        style=f"<style>{style}</style>",
        data=_data("payload", payload) + ("" if journey is None else _data("log", journey)),
        script=f"<script>{script}</script>",
    )


def _data(name: str, content: bytes) -> str:
    return (
        f'<script type="text/plain" id="{name}" data-bytes="{len(content)}">'
        f"{text_of(content)}</script>\n"
    )


def _filled(
    title: str, *, policy: str, style: str, script: str, data: str = "", log: str = ""
) -> str:
    return _PAGE.format(
        title=html.escape(f"{title} - oddsmap"), policy=policy, style=style, data=data,
        script=script, log=log,
    )  # fmt: skip


def _hash(text: str) -> str:
    """How a policy names the text of an element."""
    return f"'sha256-{base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()}'"
