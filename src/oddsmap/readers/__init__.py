# SPDX-License-Identifier: Apache-2.0
"""Readers: from a file to scans with poses, one file per format.

`open_log` looks at the content of a file, undoes its compression and hands it to the reader that
knows it. A new format is one module and one line in `registry.py`.
"""

from oddsmap.readers.registry import open_log

__all__ = ["open_log"]
