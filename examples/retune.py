# SPDX-License-Identifier: Apache-2.0
"""Read a log once, look at it through several sensor models: every posterior is a view.

python examples/retune.py oddsmap-demo/office.log.gz
"""

from __future__ import annotations

import sys

import oddsmap


def main(path: str) -> None:
    """Map a log and say how the sensor model changes what is called occupied."""
    grid = oddsmap.build_map(oddsmap.open_log(path), resolution=0.05)
    for p_hit, p_miss, prior in ((0.7, 0.4, 0.5), (0.9, 0.3, 0.5), (0.7, 0.4, 0.2)):
        view = grid.log_odds(p_hit=p_hit, p_miss=p_miss, prior=prior)
        occupied = int((view.state() == oddsmap.State.OCCUPIED).sum())
        print(f"p_hit {p_hit}, p_miss {p_miss}, prior {prior}: {occupied:,} occupied cells")


if __name__ == "__main__":
    main(sys.argv[1])
