# SPDX-License-Identifier: Apache-2.0
"""`python -m oddsmap` is `oddsmap`."""

from oddsmap.cli import main

if __name__ == "__main__":
    main()
