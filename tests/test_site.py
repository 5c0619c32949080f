# SPDX-License-Identifier: Apache-2.0
"""The documentation site: it is built without a warning, leads everywhere, and loads nothing."""

from __future__ import annotations

import json
import re
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import pytest
import yaml

import oddsmap
import oddsmap.simulate
from docs_site.run_notebook import run

ROOT = Path(__file__).resolve().parents[1]
DOCS = ROOT / "docs"
NOTEBOOKS = sorted(DOCS.glob("notebooks/*.ipynb"))
needs_mkdocs = pytest.mark.skipif(
    any(find_spec(name) is None for name in ("mkdocs", "material", "mkdocstrings", "latex2mathml")),
    reason='the site needs pip install -e ".[docs]"',
)


def entries(navigation: Any) -> list[str]:
    """The files that a navigation names, in order."""
    if isinstance(navigation, str):
        return [navigation]
    inner = navigation.values() if isinstance(navigation, dict) else navigation
    return [name for entry in inner for name in entries(entry)]


def navigation() -> list[str]:
    settings = yaml.safe_load((ROOT / "mkdocs.yml").read_text(encoding="utf-8"))
    return entries(settings["nav"])


def test_every_page_is_in_the_navigation() -> None:
    pages = [*DOCS.rglob("*.md"), *NOTEBOOKS]
    named = navigation()
    assert {path.relative_to(DOCS).as_posix() for path in pages} - set(named) == set()
    assert len(named) == len(set(named))
    assert [name for name in named if not ((DOCS / name).exists() or (ROOT / name).exists())] == []


def test_every_public_name_has_one_entry_in_the_reference() -> None:
    pages = [path.read_text(encoding="utf-8") for path in DOCS.glob("reference/*.md")]
    listed = re.findall(r"^::: oddsmap\.(\w+)$", "\n".join(pages), flags=re.MULTILINE)
    assert sorted(listed) == sorted({*oddsmap.__all__, "scale", "simulate"} - {"__version__"})


def test_the_outside_of_docs_hides_nothing_of_it() -> None:
    """In the site, docs/x and x have one place: only one of them may exist."""
    assert [path.name for path in DOCS.iterdir() if (ROOT / path.name).exists()] == []


def numbers_and_words(text: str) -> tuple[list[float], list[str]]:
    number = r"-?\d[\d,]*(?:\.\d+)?"
    found = re.findall(number, text)
    return [float(word.replace(",", "")) for word in found], re.split(number, text)


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: str(path.name))
def test_notebooks_print_what_they_were_saved_with(
    path: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Numbers to one percent: other machines round sines otherwise, and few cells differ."""
    monkeypatch.chdir(tmp_path)
    saved, again = (json.loads(path.read_text(encoding="utf-8")) for _ in range(2))
    run(again, path.name)
    for before, after in zip(saved["cells"], again["cells"], strict=True):
        if before["cell_type"] != "code":
            continue
        assert [sorted(out.get("data", ())) for out in before["outputs"]] == [
            sorted(out.get("data", ())) for out in after["outputs"]
        ]
        texts = ("".join(out["text"]) for out in before["outputs"] if "text" in out)
        new = ("".join(out["text"]) for out in after["outputs"] if "text" in out)
        for old_text, new_text in zip(texts, new, strict=True):
            old_numbers, old_words = numbers_and_words(old_text)
            new_numbers, new_words = numbers_and_words(new_text)
            assert new_words == old_words
            assert new_numbers == pytest.approx(old_numbers, rel=0.01)


@needs_mkdocs
@pytest.mark.parametrize(
    ("page", "link", "moved"),
    [
        ("README.md", "docs/method.md", "method.md"),
        ("README.md", "docs/method/full-map.md", "method/full-map.md"),
        ("README.md", "benchmarks/README.md", "benchmarks/README.md"),
        ("docs/method.md", "../benchmarks/README.md", "benchmarks/README.md"),
        ("docs/method.md", "images/inverse_model.png", "images/inverse_model.png"),
        ("docs/method/full-map.md", "../../benchmarks/README.md", "../benchmarks/README.md"),
        ("docs/method/full-map.md", "../glass.md", "../glass.md"),
        ("docs/exploring.md", "../examples/explore.py", "examples/explore.py"),
        ("docs/faq.md", "notebooks/retune.ipynb", "notebooks/retune.md"),
        ("CONTRIBUTING.md", "docs/conventions.md", "conventions.md"),
        ("docs/method.md", "https://example.org/docs/method.md", "https://example.org/docs/method.md"),
        ("docs/method.md", "../../elsewhere.md", "../../elsewhere.md"),
    ],
)  # fmt: skip
def test_links_of_the_repository_become_links_of_the_site(page: str, link: str, moved: str) -> None:
    from docs_site.links import rewritten

    text = "[a]({}) ![b]({}#c) and `x[i](j)`"
    assert rewritten(text.format(link, link), page) == text.format(moved, moved)


@needs_mkdocs
def test_equations_become_mathml() -> None:
    from docs_site.maths import block

    drawn = block(r"l = \log \frac{p}{1 - p}", "math", "maths", {}, None)
    assert re.search(r'^<div class="maths"><math .*display="block".*<mfrac>.*</math></div>$', drawn)


def test_equations_need_no_environments() -> None:
    """They would be drawn as text."""
    for page in DOCS.rglob("*.md"):
        equations = re.findall(
            r"^```math\n(.*?)^```$", page.read_text(encoding="utf-8"), re.S | re.M
        )
        assert [text for text in equations if "\\begin" in text or "&" in text] == [], page


@needs_mkdocs
def test_the_site(tmp_path: Path) -> None:
    """Built strictly: a dead link, a page without a place or a bad docstring ends in an error."""
    site = tmp_path / "site"
    done = subprocess.run(
        [sys.executable, "-m", "mkdocs", "build", "--strict", "--quiet", "--site-dir", str(site)],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    pages = {
        path.relative_to(site).as_posix(): path.read_text(encoding="utf-8")
        for path in site.rglob("*.html")
    }
    assert {"index.html", "method/index.html", "notebooks/retune/index.html"} <= set(pages)
    assert "benchmarks/index.html" in pages

    # Whatever a page loads lies in the site.
    loaded = re.compile(r"<(?:script|img|link|iframe|source)\b[^>]*?\b(?:src|href)=\"?(https?:)?//")
    assert [name for name, text in pages.items() if loaded.search(text)] == []
    styles = [path.read_text(encoding="utf-8") for path in site.rglob("*.css")]
    assert not any(re.search(r"(?:url\(|@import )[\"']?https?:", text) for text in styles)

    reference = "".join(text for name, text in pages.items() if name.startswith("reference/"))
    headings = set(re.findall(r'<h2 id="oddsmap\.(\w+)"', reference))
    assert {*oddsmap.__all__} - {"__version__"} - headings == set()
    simulated = set(re.findall(r'id="oddsmap\.simulate\.(?:\w+\.)?(\w+)"', reference))
    assert {*oddsmap.simulate.__all__} - simulated == {"Shape", "Solid"}  # unions, said in words

    formulas = [name for name, text in pages.items() if "<math" in text]
    assert {"method/index.html", "method/full-map/index.html"} <= set(formulas)
    found = json.loads((site / "search" / "search_index.json").read_text(encoding="utf-8"))
    assert any("distance_field" in entry["text"] for entry in found["docs"])
