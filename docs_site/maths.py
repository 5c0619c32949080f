# SPDX-License-Identifier: Apache-2.0
"""A hook of MkDocs: blocks of `math` (LaTeX, as GitHub draws them) become MathML in the site.

Browsers draw MathML themselves: pages load no script and no font for it. Equations of several lines
are several blocks, since `aligned` is not known to latex2mathml.
"""

from __future__ import annotations

from typing import Any

from mkdocs.config.defaults import MkDocsConfig


def block(source: str, language: str, css_class: str, options: Any, md: Any, **_: Any) -> str:
    """One block of LaTeX as MathML."""
    from latex2mathml.converter import convert

    drawn = convert(source.strip(), display="block")
    return f'<div class="{css_class}">{drawn}</div>'


def on_config(config: MkDocsConfig) -> MkDocsConfig:
    """Give blocks of `math` to the function above."""
    fences = config.mdx_configs.setdefault("pymdownx.superfences", {})
    fences["custom_fences"] = [{"name": "math", "class": "maths", "format": block}]
    return config
