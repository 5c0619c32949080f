# SPDX-License-Identifier: Apache-2.0
"""Run a command again and again, and send it SIGINT at its k-th call of a function.

    python interrupt_sweep.py POINTS WATCHED oddsmap-words...

Which call that is does not depend on how fast the machine is. Each run is a fork of one process
that has loaded nothing but `oddsmap.cli`. Before each, WATCHED (a folder, or "-") gets back what
was in it. On stdout: one JSON object per run, that without a SIGINT first.
"""

from __future__ import annotations

import hashlib
import json
import os
import shutil
import signal
import sys
import tempfile
from pathlib import Path
from types import FrameType

import oddsmap.cli


def run_interrupted(at: int, calls: int) -> int:
    """Run the command in this process with SIGINT at the call number `at`; its exit status."""
    count = 0

    def look(frame: FrameType, event: str, arg: object) -> None:
        nonlocal count
        count += event == "call"
        if count == at:
            sys.setprofile(None)
            os.kill(os.getpid(), signal.SIGINT)

    sys.setprofile(look)
    try:
        oddsmap.cli.main()
    except SystemExit as end:
        return end.code if isinstance(end.code, int) else 0
    finally:
        sys.setprofile(None)
        if not at:
            os.write(calls, b"%d" % count)
    return 0


def in_child(at: int, calls: int) -> dict[str, object]:
    with tempfile.TemporaryFile() as out, tempfile.TemporaryFile() as err:
        child = os.fork()
        if not child:
            os.dup2(out.fileno(), 1)
            os.dup2(err.fileno(), 2)
            status = 99
            try:
                status = run_interrupted(at, calls)
            except BaseException:
                sys.excepthook(*sys.exc_info())
            finally:
                sys.stdout.flush()
                sys.stderr.flush()
                os._exit(status)
        status = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
        out.seek(0)
        err.seek(0)
        return {"at": at, "status": status, "out": out.read().decode(), "err": err.read().decode()}


def digest(folder: Path) -> str:
    sum_of = hashlib.sha256()
    for file in sorted(folder.rglob("*")):
        sum_of.update(f"{file.relative_to(folder)}\0".encode())
        sum_of.update(file.read_bytes() if file.is_file() else b"")
    return sum_of.hexdigest()


def main() -> None:
    points, watched, *words = sys.argv[1:]
    sys.argv = ["oddsmap", *words]
    # Whoever runs the tests in the background has Ctrl-C ignored, and hands that on.
    signal.signal(signal.SIGINT, signal.default_int_handler)
    folder = None if watched == "-" else Path(watched)
    kept = folder and Path(tempfile.mkdtemp()) / "kept"
    if folder and kept:
        shutil.copytree(folder, kept)
    read_end, calls = os.pipe()
    total = 0
    for k in range(int(points) + 1):
        if folder and kept:
            shutil.rmtree(folder)
            shutil.copytree(kept, folder)
        # The first call is that of `main` itself.
        done = in_child(2 + (k - 1) * (total - 2) // int(points) if k else 0, calls)
        if not k:
            total = int(os.read(read_end, 99))
        print(json.dumps(done | {"digest": folder and digest(folder)}))  # noqa: T201


if __name__ == "__main__":
    main()
