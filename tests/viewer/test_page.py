# SPDX-License-Identifier: Apache-2.0
"""The page that is shipped is what `web/` builds; the file that is written holds all it needs."""

from __future__ import annotations

import base64
import hashlib
import json
import os
import re
import shutil
import subprocess
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from oddsmap.viewer.document import page_part, served_page, single_page
from oddsmap.viewer.text import text_of

WEB = Path(__file__).resolve().parents[2] / "web"
BUILT = ("viewer.css", "viewer.js", "widget.js")


def digest(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()


def sources() -> list[str]:
    """As in web/vite.config.ts."""
    own = [path.relative_to(WEB).as_posix() for path in (WEB / "src").rglob("*") if path.is_file()]
    return sorted(
        [*own, "package.json", "package-lock.json", "tsconfig.json", "vite.config.ts"]
    )  # fmt: skip


def test_the_page_was_built_from_these_sources() -> None:
    built = json.loads(page_part("build.json"))
    text = b"".join(f"{name}\0".encode() + (WEB / name).read_bytes() + b"\0" for name in sources())
    assert built["sources"] == digest(text), "build the page: cd web && npm ci && npm run build"
    assert {name: digest(page_part(name)) for name in BUILT} == {
        name: built[name] for name in BUILT
    }, "the page was changed by hand: change web/src"


def test_the_same_sources_build_the_same_page(tmp_path: Path) -> None:
    node = shutil.which("node")
    if node is None or not (WEB / "node_modules").is_dir():
        pytest.skip("needs Node and web/node_modules (npm ci)")
    done = subprocess.run(
        [node, "node_modules/vite/bin/vite.js", "build"], cwd=WEB, capture_output=True, text=True,
        env={**os.environ, "ODDSMAP_PAGE": str(tmp_path)}, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    for name in (*BUILT, "build.json"):
        assert (tmp_path / name).read_bytes() == page_part(name)


def test_code_is_small() -> None:
    assert sum(len(page_part(name)) for name in BUILT[:2]) < 200_000


def policy_of(page: str) -> dict[str, str]:
    (text,) = re.findall(r'Content-Security-Policy" content="([^"]+)"', page)
    return dict(part.strip().partition(" ")[::2] for part in text.split(";"))


def bytes_of(text: str, length: int) -> bytes:
    """`text_of` undone: one number of 13 bits after the other."""
    digits = [chr(code) for code in range(33, 127) if chr(code) not in '"&<']
    pairs = (digits.index(a) * 91 + digits.index(b) for a, b in zip(*[iter(text)] * 2, strict=True))
    bits = "".join(f"{number:013b}" for number in pairs)
    return bytes(int(bits[8 * i : 8 * i + 8], 2) for i in range(length))


@given(st.binary(max_size=60))
def test_bytes_as_text(data: bytes) -> None:
    text = text_of(data)
    assert bytes_of(text, len(data)) == data
    assert len(text) == 16 * -(-len(data) // 13)
    assert text.isascii()
    assert not set(text) & set('"&< ')


def test_many_bytes_as_text() -> None:
    """In more than one part, each of which ends with a whole number of characters."""
    data = bytes(range(256)) * 3400
    text = text_of(data)
    for start in (0, 13 * 1000, (13 << 16) - 13, 13 << 16):
        at = start // 13 * 16
        assert bytes_of(text[at : at + 32], 26) == data[start : start + 26]


def test_a_file_holds_all_it_needs_and_runs_nothing_else() -> None:
    payload = bytes(range(256)) * 9
    page = single_page('x"><script>alert(1)</script>', payload)
    assert "<script>alert" not in page
    policy = policy_of(page)
    assert policy["default-src"] == "'none'"
    assert "connect-src" not in policy
    assert "'unsafe" not in str(policy)
    (style,) = re.findall(r"<style>(.*?)</style>", page, re.S)
    data, script = re.findall(r"<script(?: type=[^>]*)?>(.*?)</script>", page, re.S)
    for text, kind in ((style, "style-src"), (script, "script-src")):
        hashed = base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()
        assert policy[kind] == f"'sha256-{hashed}'"
    assert bytes_of(data, len(payload)) == payload
    assert f'data-bytes="{len(payload)}"' in page
    loaded = re.findall(r"""(?:src|href)=["']?([^"'>\s]+)""", page.replace(script, ""))
    assert loaded == ["data:,"]


def test_a_served_page_names_what_lies_beside_it() -> None:
    page = served_page("m")
    loaded = re.findall(r'(?:src|href)="([^"]+)"', page)
    assert loaded == ["data:,", "viewer.css", "viewer.js"]
    assert policy_of(page)["connect-src"] == "'self'"
