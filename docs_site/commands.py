# SPDX-License-Identifier: Apache-2.0
"""Write the pages of the command line: what each command says of itself, and all settings.

python docs_site/commands.py
"""

from __future__ import annotations

from importlib.metadata import version
from pathlib import Path

__all__ = [
    "COMMANDS_PAGE",
    "MORE",
    "RENEWED_BY",
    "SETTINGS_PAGE",
    "commands_page",
    "names",
    "settings_page",
]

ROOT = Path(__file__).resolve().parents[1]
COMMANDS_PAGE = ROOT / "docs" / "reference" / "commands.md"
SETTINGS_PAGE = ROOT / "docs" / "reference" / "settings.md"
RENEWED_BY = "python docs_site/commands.py"

# Where there is more to read than a command's own help.
MORE = {
    "build": "your own data from [a bag](../from-a-bag.md), from [a folder](../from-a-folder.md) "
    "or from [other files](../from-other-files.md); [sensor models](../sensors.md)",
    "view": "[the viewer](../viewer.md)",
    "export": "[maps for others](../maps-out.md), [formats](../formats.md)",
    "costmap": "[costs](../planning.md#costs)",
    "info": "[formats](../formats.md#logs)",
    "config": "what it prints is the page of [settings](settings.md)",
    "calibrate": "[full-map estimation](../method/full-map.md)",
    "score": "[are the probabilities true?](../true-probabilities.md)",
    "why": "[why is a cell so?](../why.md)",
    "merge": "[maps combined](../combining.md)",
    "subtract": "[maps combined](../combining.md)",
    "history": "[a map with its history](../combining.md#a-map-with-its-history)",
    "crop": "[maps combined](../combining.md)",
    "rotate-frame": "[maps combined](../combining.md)",
    "compare": "[maps combined](../combining.md)",
    "resample": "[maps combined](../combining.md)",
    "clean": "[moving worlds](../moving-worlds.md)",
    "landmarks": "[landmarks](../method/landmarks.md)",
    "demo": "[ten minutes, one log](../start-here.md)",
}


def printed(*words: str) -> str:
    """What `oddsmap WORDS` prints in a terminal of 100 columns."""
    from typer.testing import CliRunner

    from oddsmap.cli.app import app

    terminal = {"COLUMNS": "100", "TERM": "dumb"}
    runner = CliRunner()
    done = runner.invoke(app, words, prog_name="oddsmap", env=terminal, catch_exceptions=False)
    return "\n".join(line.rstrip() for line in done.stdout.splitlines()) + "\n"


def names() -> list[str]:
    """The commands, in the order in which `oddsmap -h` lists them."""
    from typer.main import get_command

    from oddsmap.cli.app import app

    # An app of several commands is a group, which its type does not say.
    return list(get_command(app).commands)  # type: ignore[attr-defined]


def commands_page() -> str:
    """The page of all commands."""
    parser = f"typer {version('typer')}, click {version('click')}"
    parts = [
        f"# Commands\n\n<!-- {RENEWED_BY} ({parser}) -->\n",
        "What each command says of itself, as `oddsmap COMMAND -h` prints it. [Exit status]"
        "(../conventions.md#exit-status)\nsays how commands end.\n",
        f"```text\n{printed('-h')}```\n",
    ]
    for name in names():
        parts.append(f"## {name}\n\n```text\n{printed(name, '-h')}```\n")
        if name in MORE:
            parts.append(f"More: {MORE[name]}.\n")
    return "\n".join(parts)


def settings_page() -> str:
    """The page of all settings."""
    return (
        f"# Settings\n\n<!-- {RENEWED_BY} -->\n\n"
        "All settings, as `oddsmap config` prints them: a file for `--config`, too. `--set "
        "sensor.range_max=30` sets one of\nthem; what a map was made with is kept in it, and "
        "`oddsmap info MAP -v` shows it.\n\n"
        f"```toml\n{printed('config')}```\n"
    )


def main() -> None:
    """Write both pages."""
    COMMANDS_PAGE.write_text(commands_page(), encoding="utf-8")
    SETTINGS_PAGE.write_text(settings_page(), encoding="utf-8")


if __name__ == "__main__":
    main()
