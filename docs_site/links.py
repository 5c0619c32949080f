# SPDX-License-Identifier: Apache-2.0
"""A hook of MkDocs: relative links of the repository, also those that leave docs/, in the site.

Pages link to each other as they lie in the repository, so that they work on GitHub. The site has
the same paths with docs/ as its root: docs/method.md is method.md there, benchmarks/README.md
keeps its name. What pages link to outside docs/ becomes part of the site.
"""

from __future__ import annotations

import posixpath
import re
from pathlib import Path

from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files
from mkdocs.structure.pages import Page

ROOT = Path(__file__).resolve().parents[1]
OUTSIDE = ("README.md", "CHANGELOG.md", "CONTRIBUTING.md", "SECURITY.md", "benchmarks/README.md")
LINK = re.compile(r"(?<=\]\()([^)\s#]+)(?=[)#])")


def in_site(path: str) -> str:
    """Where a file of the repository is in the site."""
    path = path.removeprefix("docs/")
    return path.removesuffix(".ipynb") + ".md" if path.endswith(".ipynb") else path


def in_repository(src_uri: str) -> str:
    """Where a page of the site lies in the repository; the empty text for one that is made."""
    places = (f"docs/{src_uri}", src_uri)
    return next((place for place in places if (ROOT / place).is_file()), "")


def target(page: str, link: str) -> str:
    """The file of the repository that a link of a page names, or the empty text."""
    path = posixpath.normpath(posixpath.join(posixpath.dirname(page), link))
    return path if ":" not in link and not path.startswith("..") and (ROOT / path).is_file() else ""


def rewritten(markdown: str, page: str) -> str:
    """A page of the repository, with its links as the site needs them."""
    folder = posixpath.dirname(in_site(page))

    def moved(link: re.Match[str]) -> str:
        path = target(page, link.group())
        return posixpath.relpath(in_site(path), folder or ".") if path else link.group()

    return LINK.sub(moved, markdown)


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """The files outside docs/ that are pages of the site, and what any page links to."""
    waiting = [*OUTSIDE, *(f"docs/{file.src_uri}" for file in files.documentation_pages())]
    while waiting:
        path = waiting.pop()
        if files.get_file_from_path(in_site(path)) is None:
            source = str(ROOT / path)
            files.append(File.generated(config, in_site(path), abs_src_path=source))
        if path.endswith(".md"):
            links = LINK.findall((ROOT / path).read_text(encoding="utf-8"))
            # Pages of notebooks are made by notebooks.py.
            named = {target(path, link) for link in links if not link.endswith(".ipynb")} - {""}
            waiting += [name for name in named if files.get_file_from_path(in_site(name)) is None]
    return files


def on_page_markdown(markdown: str, page: Page, config: MkDocsConfig, files: Files) -> str:
    """The text of a page with its links rewritten."""
    path = in_repository(page.file.src_uri)
    return rewritten(markdown, path) if path else markdown
