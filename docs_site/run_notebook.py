# SPDX-License-Identifier: Apache-2.0
"""Run the cells of notebooks and save their outputs, without Jupyter.

python docs_site/run_notebook.py docs/notebooks/*.ipynb
"""

from __future__ import annotations

import ast
import base64
import contextlib
import io
import json
import sys
from pathlib import Path
from typing import Any

__all__ = ["run"]


def _executed(source: str, names: dict[str, Any], name: str) -> tuple[str, Any]:
    """What a cell prints, and the value of its last line where that is an expression."""
    body = ast.parse(source).body
    last = body.pop() if body and isinstance(body[-1], ast.Expr) else None
    printed, value = io.StringIO(), None
    with contextlib.redirect_stdout(printed):
        exec(compile(ast.Module(body, []), name, "exec"), names)
        if isinstance(last, ast.Expr):
            value = eval(compile(ast.Expression(last.value), name, "eval"), names)
    return printed.getvalue(), value


def _png(value: Any) -> bytes | None:
    """The picture that Jupyter would show of a value."""
    if type(value).__module__ == "matplotlib.figure":
        content = io.BytesIO()
        value.savefig(content, format="png", dpi=72, metadata={"Software": None})
        return content.getvalue()
    draw = getattr(value, "_repr_png_", None)
    return draw() if draw is not None else None


def _outputs(printed: str, value: Any, count: int) -> list[dict[str, Any]]:
    outputs: list[dict[str, Any]] = []
    if printed:
        lines = printed.splitlines(keepends=True)
        outputs.append({"name": "stdout", "output_type": "stream", "text": lines})
    if value is not None:
        data: dict[str, Any] = {"text/plain": repr(value).splitlines(keepends=True)}
        picture = _png(value)
        if picture is not None:
            data["image/png"] = base64.b64encode(picture).decode()
        outputs.append(
            {
                "data": data,
                "execution_count": count,
                "metadata": {},
                "output_type": "execute_result",
            }
        )
    return outputs


def run(notebook: dict[str, Any], name: str) -> None:
    """Run all cells from top to bottom, in this process, and put their outputs into the notebook.

    Args:
        notebook: what the JSON of the file holds; it is changed.
        name: what tracebacks call it.
    """
    names: dict[str, Any] = {"__name__": "__main__"}
    cells = [cell for cell in notebook["cells"] if cell["cell_type"] == "code"]
    for count, cell in enumerate(cells, 1):
        printed, value = _executed("".join(cell["source"]), names, f"{name}, cell {count}")
        cell["execution_count"] = count
        cell["outputs"] = _outputs(printed, value, count)


if __name__ == "__main__":
    for path in map(Path, sys.argv[1:]):
        notebook = json.loads(path.read_text(encoding="utf-8"))
        run(notebook, path.name)
        path.write_text(json.dumps(notebook, indent=1, ensure_ascii=False) + "\n", "utf-8")
