# SPDX-License-Identifier: Apache-2.0
"""A hook of MkDocs: notebooks become pages, with the outputs that they were saved with.

Nothing is run here; `python docs_site/run_notebook.py` does that, and a test holds that the saved
outputs are those of the cells.
"""

from __future__ import annotations

import html
import json
from pathlib import Path
from typing import Any

from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files


def shown(output: dict[str, Any]) -> str:
    """One output of a cell, as HTML."""
    data = output.get("data", {})
    if "image/png" in data:
        picture = "".join(data["image/png"]).replace("\n", "")
        return (
            f'<img class="output" alt="What the cell draws" src="data:image/png;base64,{picture}">'
        )
    text = "".join(output.get("text") or data["text/plain"])
    return f'<pre class="output">{html.escape(text.rstrip())}</pre>'


def page(notebook: dict[str, Any], name: str) -> str:
    """A notebook as Markdown, with a link to the file below its title."""
    parts = []
    for cell in notebook["cells"]:
        source = "".join(cell["source"])
        if cell["cell_type"] == "markdown":
            parts.append(source)
            continue
        parts.append(f"```python\n{source}\n```")
        parts += [shown(output) for output in cell["outputs"]]
    title, _, rest = "\n\n".join(parts).partition("\n")
    download = f'<a href="../{name}" download>Download this page as a notebook</a>'
    return f"{title}\n\n{download}\n{rest}\n"


def on_config(config: MkDocsConfig) -> MkDocsConfig:
    """Let the navigation name notebooks by their files."""

    def renamed(entry: Any) -> Any:
        if isinstance(entry, dict):
            return {title: renamed(inner) for title, inner in entry.items()}
        if isinstance(entry, list):
            return [renamed(inner) for inner in entry]
        return entry.removesuffix(".ipynb") + ".md" if entry.endswith(".ipynb") else entry

    config.nav = renamed(config.nav)
    return config


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Beside each notebook the page that is made of it."""
    for file in [file for file in files if file.src_uri.endswith(".ipynb")]:
        path = Path(config.docs_dir, file.src_uri)
        content = page(json.loads(path.read_text(encoding="utf-8")), path.name)
        uri = file.src_uri.removesuffix(".ipynb") + ".md"
        files.append(File.generated(config, uri, content=content))
    return files
