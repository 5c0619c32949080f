# SPDX-License-Identifier: Apache-2.0
"""Which prior and coupling predict readings best that the map has not seen?

    python benchmarks/full_map_prior.py LOG... [--resolution 0.1]

Every tenth scan of each log is held back, the rest is mapped for each pair of prior and coupling,
and the mean log likelihood of the held-out readings is printed [nats a beam]; a pair whose messages
did not come to rest within the sweeps allowed has an asterisk.
"""

from __future__ import annotations

import argparse
import os
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
sys.path[:0] = [str(ROOT), str(ROOT / "src")]

import oddsmap
from oddsmap.config.full_map import FullMapConfig
from oddsmap.scans.split_log import hold_out
from oddsmap.scoring.held_out import score_map

PRIORS = (0.05, 0.1, 0.2, 0.475)
COUPLINGS = (0.0, 0.2, 0.4, 0.8)


def main() -> None:
    """Print a table for each log."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("logs", nargs="+", type=Path, metavar="LOG")
    parser.add_argument("--resolution", type=float, default=0.1)
    given = parser.parse_args()
    for path in given.logs:
        log = oddsmap.open_log(path)
        mapped, held = hold_out(log, 10)
        print(f"{path.name}\nprior     " + "".join(f"   J = {j:<5}" for j in COUPLINGS))
        for prior in PRIORS:
            row = f"{prior:<10}"
            for coupling in COUPLINGS:
                full_map = oddsmap.build_full_map(
                    mapped,
                    given.resolution,
                    settings=FullMapConfig(prior=prior, coupling=coupling),
                    threads=os.cpu_count() or 1,
                )
                scores = score_map(full_map, held, full_map.config.sensor)
                rests = " " if full_map.converged else "*"
                row += f"{scores.log_likelihood:10.3f}{rests} "
            print(row, flush=True)


if __name__ == "__main__":
    main()
