# SPDX-License-Identifier: Apache-2.0
"""Cases in a process of their own, which ends where one takes too long or too much."""

from __future__ import annotations

import os
import shutil
import signal
import sys
import tempfile
from collections.abc import Iterable, Iterator
from pathlib import Path

from tests.fuzz.answers import Answer
from tests.fuzz.judge import Outcome, judge, mutant_of
from tests.fuzz.mutant import Files
from tests.fuzz.readers import Reader

__all__ = ["run_cases"]

_CPU_SECONDS = 10.0  # of one case; most take a hundredth
_MEMORY = 2 << 30  # bytes of addresses beyond those of the libraries


def run_cases(reader: Reader, seed: int, numbers: Iterable[int]) -> Iterator[tuple[int, Outcome]]:
    """The outcome of each case, by number.

    A child is forked, so that kernels are compiled once, here, and does case after case. Where it
    dies, the case it was at is to blame, and another child goes on after it.
    """
    if sys.platform == "win32":
        raise NotImplementedError("needs fork")
    sample = reader.sample()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for path, content in sample.items():
            (folder / path).parent.mkdir(parents=True, exist_ok=True)
            (folder / path).write_bytes(content)
        before = Path.cwd()
        os.chdir(folder)
        try:
            good = reader.read(Path(reader.path))
        finally:
            os.chdir(before)
    left = list(numbers)
    while left:
        out, back = os.pipe()
        child = os.fork()
        if child == 0:
            os.close(out)
            status = 1
            try:
                _limit_memory()
                with os.fdopen(back, "w", encoding="utf-8") as pipe:
                    for number in left:
                        outcome = _one(reader, sample, good, seed, number)
                        text = outcome.what.encode("ascii", "backslashreplace").decode()
                        pipe.write(f"{outcome.kind}\t{text!r}\n")
                        pipe.flush()
                status = 0
            finally:
                os._exit(status)
        os.close(back)
        with os.fdopen(out, encoding="utf-8") as pipe:
            for line in pipe:
                kind, what = line.rstrip("\n").split("\t", 1)
                yield left.pop(0), Outcome(kind, what)
        _, status = os.waitpid(child, 0)
        if not left:
            continue
        blamed = left.pop(0)
        killed = os.WTERMSIG(status) if os.WIFSIGNALED(status) else 0
        kind = "hang" if killed == signal.SIGPROF else "crash"
        what = mutant_of(reader, sample, seed, blamed).what
        yield blamed, Outcome(kind, f"{what}: signal {killed}, status {status}")


def _one(reader: Reader, sample: Files, good: Answer, seed: int, number: int) -> Outcome:
    if sys.platform == "win32":
        raise NotImplementedError("needs signals")
    folder = Path(tempfile.mkdtemp(prefix="oddsmap-fuzz-"))
    os.chdir(folder)
    try:
        mutant = mutant_of(reader, sample, seed, number)
        signal.signal(signal.SIGPROF, signal.SIG_DFL)
        signal.setitimer(signal.ITIMER_PROF, _CPU_SECONDS)
        outcome = judge(reader, mutant, good, folder)
        signal.setitimer(signal.ITIMER_PROF, 0.0)
        return outcome
    finally:
        os.chdir("/")
        shutil.rmtree(folder, ignore_errors=True)


def _limit_memory() -> None:
    sys.stdout = sys.stderr = open(os.devnull, "w")  # noqa: PTH123, SIM115
    if sys.platform == "win32":
        raise NotImplementedError("needs limits of memory")
    import resource

    pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[0])
    limit = pages * os.sysconf("SC_PAGE_SIZE") + _MEMORY
    resource.setrlimit(resource.RLIMIT_AS, (limit, limit))
