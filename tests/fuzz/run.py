# SPDX-License-Identifier: Apache-2.0
"""`python -m tests.fuzz.run --cases 1000`: the table of outcomes, and each bad one."""

from __future__ import annotations

import argparse
import sys
from collections import Counter

from tests.fuzz.judge import BAD, KINDS
from tests.fuzz.readers import READERS
from tests.fuzz.watchdog import run_cases


def _children_s() -> float:
    """CPU time of the processes that have ended."""
    if sys.platform == "win32":
        raise NotImplementedError("needs fork")
    import resource

    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def main() -> int:
    """Run cases; the exit status is 1 where one is neither right nor one line."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--reader", action="append", choices=list(READERS), help="default: all")
    parser.add_argument("--cases", type=int, default=100, help="of each reader")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--first", type=int, default=0, help="number of the first case")
    parser.add_argument("--all", action="store_true", help="print each case, not the bad ones only")
    options = parser.parse_args()
    write = sys.stdout.write
    width = max(map(len, READERS))
    write(f"{'':{width}} " + " ".join(f"{kind:>12}" for kind in KINDS) + "     CPU s\n")
    total: Counter[str] = Counter()
    for name in options.reader or READERS:
        began = _children_s()
        counts: Counter[str] = Counter()
        numbers = range(options.first, options.first + options.cases)
        for number, outcome in run_cases(READERS[name], options.seed, numbers):
            counts[outcome.kind] += 1
            if options.all or outcome.kind in BAD:
                write(
                    f"  {name} --seed {options.seed} --first {number}: "
                    f"{outcome.kind}: {outcome.what}\n"
                )
        children = _children_s() - began
        write(
            f"{name:{width}} "
            + " ".join(f"{counts[kind]:12}" for kind in KINDS)
            + f"{children:10.1f}\n"
        )
        sys.stdout.flush()
        total += counts
    write(f"{'all':{width}} " + " ".join(f"{total[kind]:12}" for kind in KINDS) + "\n")
    return 1 if any(total[kind] for kind in BAD) else 0


if __name__ == "__main__":
    sys.exit(main())
