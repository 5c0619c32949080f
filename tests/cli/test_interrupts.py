# SPDX-License-Identifier: Apache-2.0
"""Ctrl-C: one line and exit status 130, whenever it comes."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from oddsmap.cli import INTERRUPTED, main
from oddsmap.cli.interrupts import interruptible
from tests.cli.conftest import Run, folder_bytes

pytestmark = pytest.mark.skipif(not hasattr(os, "fork"), reason="needs signals and fork")

LINE = f"oddsmap: {INTERRUPTED}\n"

# Maps one log again and again, and says when it has begun: however slow the machine is, it is not
# done before it is interrupted. Whoever runs the tests in the background has Ctrl-C ignored, and
# hands that on.
_LONG_BUILD = """
import signal
signal.signal(signal.SIGINT, signal.default_int_handler)

from oddsmap.cli import main
from oddsmap.integrate import add

add_log = add.add_log

def add_log_often(*args, **kwargs):
    add_log(*args, **kwargs)
    print("mapping", flush=True)
    for _ in range(100_000):
        add_log(*args, **kwargs)

add.add_log = add_log_often
main()
"""


@pytest.fixture(autouse=True)
def heeded() -> Iterator[None]:
    """Ctrl-C as in a terminal, also where the tests run in the background."""
    before, hook = signal.signal(signal.SIGINT, signal.default_int_handler), sys.unraisablehook
    yield
    signal.signal(signal.SIGINT, before)
    sys.unraisablehook = hook


def interrupt() -> None:
    signal.raise_signal(signal.SIGINT)


def ended_by_ctrl_c(status: int, err: str) -> bool:
    """With its status and its line, the last one, and nothing of what Python would say."""
    said = "Traceback" in err or "Aborted" in err or "ignored in" in err
    return status == 130 and err.endswith(LINE) and not said


def sweep(points: int, watched: Path | str, *words: object) -> list[dict[str, Any]]:
    script = Path(__file__).parent / "interrupt_sweep.py"
    done = subprocess.run(
        [sys.executable, str(script), str(points), str(watched), *map(str, words)],
        capture_output=True, text=True, check=False,
        env={**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)},
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    return [json.loads(line) for line in done.stdout.splitlines()]


def test_while_packages_are_imported() -> None:
    whole, *runs = sweep(12, "-", "--help")
    assert whole["status"] == 0
    assert len(runs) == 12
    for done in runs:
        assert ended_by_ctrl_c(done["status"], done["err"]), done


@pytest.mark.parametrize("points", [3, pytest.param(40, marks=pytest.mark.slow)])
def test_at_any_moment_of_a_build(run: Run, office: Path, tmp_path: Path, points: int) -> None:
    folder = tmp_path / "maps"
    folder.mkdir()
    words = ("build", office, "-o", folder / "x.zarr", "--threads", 1, "--force", "--resolution")
    assert run(*words, 0.4).status == 0
    whole, *runs = sweep(points, folder, *words, 0.2)
    assert whole["status"] == 0
    for done in runs:
        assert ended_by_ctrl_c(done["status"], done["err"]), done
    # No other file, and no other content: the old map, or in the end the new one.
    old = runs[0]["digest"]
    assert old != whole["digest"]
    assert {done["digest"] for done in runs} <= {old, whole["digest"]}


def test_in_the_midst_of_mapping(run: Run, office: Path, tmp_path: Path) -> None:
    out = tmp_path / "x.zarr"
    run("build", office, "--resolution", 0.2, "-o", out)
    before = folder_bytes(out)
    command = [sys.executable, "-c", _LONG_BUILD, "build", str(office), "--resolution", "0.1"]
    with subprocess.Popen(
        [*command, "-o", str(out), "--force"],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    ) as process:
        assert process.stdout is not None
        assert process.stderr is not None
        assert process.stdout.readline() == "mapping\n", process.stderr.read()
        process.send_signal(signal.SIGINT)
        _, err = process.communicate()
    assert ended_by_ctrl_c(process.returncode, err), err
    assert folder_bytes(out) == before
    assert [path.name for path in tmp_path.iterdir()] == ["x.zarr"]


def module(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, text: str) -> None:
    """A module `stranger` that is imported anew."""
    (tmp_path / "stranger.py").write_text(f"import signal\n{text}\nfinished = True\n")
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.delitem(sys.modules, "stranger", raising=False)


def test_an_import_that_would_swallow_it_is_finished_first(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    text = (
        "try:\n    signal.raise_signal(signal.SIGINT)\nexcept BaseException:\n    raise ImportError"
    )
    module(tmp_path, monkeypatch, text)
    with pytest.raises(KeyboardInterrupt), interruptible():  # noqa: PT012
        import stranger  # type: ignore[import-not-found]

        len("the next call")
        pytest.fail("was not interrupted")
    assert sys.modules["stranger"].finished
    assert not stranger.__spec__._initializing


def test_the_second_time_an_import_does_not_wait(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    module(tmp_path, monkeypatch, "for _ in range(2):\n    signal.raise_signal(signal.SIGINT)")
    with pytest.raises(KeyboardInterrupt), interruptible():
        import stranger  # noqa: F401
    assert "stranger" not in sys.modules


def test_it_is_not_lost_where_nothing_can_be_raised(capsys: pytest.CaptureFixture[str]) -> None:
    class Dying:
        def __del__(self) -> None:
            interrupt()

    with pytest.raises(KeyboardInterrupt), interruptible():  # noqa: PT012
        dying = Dying()
        del dying
        len("the next call")
        pytest.fail("was not interrupted")
    assert capsys.readouterr().err == ""


def test_what_half_made_objects_say_of_their_end_is_not_shown(
    capsys: pytest.CaptureFixture[str],
) -> None:
    class HalfMade:
        def __init__(self) -> None:
            interrupt()
            self.handle = 1

        def __del__(self) -> None:
            str(self.handle)

    with pytest.raises(KeyboardInterrupt), interruptible():
        HalfMade()
    HalfMade.__new__(HalfMade)  # dies when all is over
    assert capsys.readouterr().err == ""


def test_the_second_time_does_not_break_off_clearing_up() -> None:
    cleared = []
    with pytest.raises(KeyboardInterrupt), interruptible():  # noqa: PT012
        try:
            interrupt()
        finally:
            interrupt()
            cleared.append("files")
    assert cleared == ["files"]


def test_the_third_time_is_heeded() -> None:
    with pytest.raises(KeyboardInterrupt), interruptible():  # noqa: PT012
        try:
            interrupt()
        finally:
            interrupt()
            interrupt()
            pytest.fail("was not interrupted")


def test_ignored_in_the_background() -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    with interruptible():
        interrupt()
    assert signal.getsignal(signal.SIGINT) is signal.SIG_IGN


def test_other_threads_are_left_alone() -> None:
    def work() -> None:
        with interruptible():
            seen.append(signal.getsignal(signal.SIGINT))

    seen: list[object] = []
    thread = threading.Thread(target=work)
    thread.start()
    thread.join()
    assert seen == [signal.default_int_handler]


def test_what_is_left_behind(capsys: pytest.CaptureFixture[str]) -> None:
    hook = sys.unraisablehook
    with interruptible():
        pass
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler
    assert sys.unraisablehook is hook
    # When the status is settled the process only has to end.
    with pytest.raises(KeyboardInterrupt), interruptible():
        interrupt()
    assert signal.getsignal(signal.SIGINT) is signal.SIG_IGN


def test_before_there_is_a_handler(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def fail(*args: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("oddsmap.cli.interrupts.interruptible", fail)
    with pytest.raises(SystemExit) as end:
        main()
    assert (end.value.code, capsys.readouterr().err) == (130, LINE)
