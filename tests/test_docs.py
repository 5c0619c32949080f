# SPDX-License-Identifier: Apache-2.0
"""The documents: their links lead somewhere, and what the README shows runs as it stands."""

from __future__ import annotations

import doctest
import re
import runpy
import shlex
import sys
from pathlib import Path

import pytest

from oddsmap.cli import main

ROOT = Path(__file__).resolve().parents[1]
PAGES = sorted([*ROOT.glob("*.md"), *ROOT.glob("docs/**/*.md"), *ROOT.glob("benchmarks/*.md")])
INSTALLS = ("pip install .", 'pip install -e ".[dev]"', "pytest")


def prose(page: Path) -> str:
    """A page without its blocks of code, in which brackets mean something else."""
    text = page.read_text(encoding="utf-8")
    return re.sub(r"^```.*?^```$", "", text, flags=re.DOTALL | re.MULTILINE)


def blocks(text: str) -> list[tuple[str, str]]:
    """Language and content of each block of code, in order."""
    return re.findall(r"^```(\w+)\n(.*?)^```$", text, flags=re.DOTALL | re.MULTILINE)


def commands(block: str) -> list[str]:
    """The commands of a block of shell, one by one, without comments."""
    lines = (line.split("  #")[0].strip() for line in block.splitlines())
    return [command.strip() for line in lines if line for command in line.split("&&")]


def anchors(page: Path) -> set[str]:
    """What headings may be linked to, by GitHub's rule."""
    headings = re.findall(r"^#+ (.+)$", prose(page), flags=re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", title.lower()).replace(" ", "-") for title in headings}


def test_this_test_sees_blocks_and_commands() -> None:
    text = 'a [b](c)\n```sh\nx -o y && z "1 2"   # why\n\n# note\nv\n```\n```python\n1\n```\n'
    assert [language for language, _ in blocks(text)] == ["sh", "python"]
    assert commands("x -o y && z   # why\n\nv\n") == ["x -o y", "z", "v"]
    assert ROOT / "README.md" in PAGES
    assert "exit-status" in anchors(ROOT / "docs" / "conventions.md")


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_links_lead_somewhere(page: Path) -> None:
    dead = []
    for target in re.findall(r"\]\(([^)\s]+)\)", prose(page)):
        if re.match(r"\w+:", target):
            continue  # the tests load nothing from the network
        name, _, anchor = target.partition("#")
        there = (page.parent / name) if name else page
        if not there.exists() or (anchor and anchor not in anchors(there)):
            dead.append(target)
    assert not dead


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_files_named_in_the_text_exist(page: Path) -> None:
    """`kernels/trace/rays3d.py` and the like, from the page, the repository or the package."""
    places = (page.parent, ROOT, ROOT / "src" / "oddsmap")
    named = re.findall(r"`([\w/]+/[\w/]*\w\.(?:py|md))`", prose(page))
    assert [name for name in named if not any((place / name).exists() for place in places)] == []


def test_what_the_documents_compute_comes_out() -> None:
    ran = {page: doctest.testfile(str(page), module_relative=False) for page in PAGES}
    assert all(result.failed == 0 for result in ran.values())
    assert ran[ROOT / "docs" / "method" / "full-map.md"].attempted >= 10


def test_the_readme_runs_as_it_stands(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Every block from top to bottom, in an empty folder: installing aside, as a newcomer would."""
    monkeypatch.chdir(tmp_path)
    shown = blocks((ROOT / "README.md").read_text(encoding="utf-8"))
    assert [language for language, _ in shown].count("python") >= 2
    ran = 0
    for language, block in shown:
        if language == "python":
            exec(compile(block, "README.md", "exec"), {"__name__": "__main__"})
            ran += 1
            continue
        assert language == "sh"
        for command in commands(block):
            if command in INSTALLS:
                continue
            words = shlex.split(command)
            if words[0] == "python":
                monkeypatch.setattr(sys, "argv", words[1:])
                runpy.run_path(str(ROOT / words[1]), run_name="__main__")
                ran += 1
                continue
            assert words[0] == "oddsmap", command
            monkeypatch.setattr(sys, "argv", words)
            with pytest.raises(SystemExit) as end:
                main()
            assert not end.value.code, command
            ran += 1
    assert ran >= 8
    made = "coarse.yaml coarse.pgm fine.yaml town.bt town.html full_map.png sonar.zarr/zarr.json"
    for name in made.split():
        assert (tmp_path / "oddsmap-demo" / name).stat().st_size > 0
    # All in the folder that git ignores: a newcomer's tree stays clean.
    assert [path.name for path in tmp_path.iterdir()] == ["oddsmap-demo"]


def test_the_speed_that_the_readme_states_is_measured_in_the_benchmarks() -> None:
    """One place holds the figures; whoever measures again must see that the README quotes them."""
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    fast = re.search(r"^- \*\*Fast\.\*\*.*?(?=^$)", readme, flags=re.DOTALL | re.MULTILINE)
    assert fast is not None
    stated = re.findall(r"(\d[\d.]*) (?:times as fast|times for|and|million)", fast.group())
    measured = (ROOT / "benchmarks" / "README.md").read_text(encoding="utf-8")
    assert len(stated) >= 4
    memory = re.findall(r"(\d+) MB", re.search(r"^\| oddsmap: CPU.*$", measured, re.M).group())  # type: ignore[union-attr]
    theirs = re.findall(r"(\d+) MB", re.search(r"^\| OctoMap: CPU.*$", measured, re.M).group())  # type: ignore[union-attr]
    shares = {f"{int(a) / int(b):.2f}" for a, b in zip(memory, theirs, strict=True)}
    for figure in stated:
        assert figure in shares or re.search(rf"\b{re.escape(figure)}\b", measured), figure
