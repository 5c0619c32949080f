# SPDX-License-Identifier: Apache-2.0
"""Writing that leaves the old file or folder, the new one or none, never a half.

`output.py` is the whole way; `work_folder.py` is where the new one is made, and how what a killed
run left of it is found (`lock.py`); `swap.py` puts it in place; `sync.py` sees to it that it is on
the disk; `writer_lock.py` lets one process at a time add to an output.
"""

from oddsmap.atomic_write.output import (
    atomic_output,
    atomic_outputs,
    check_output,
    why_no_file,
)
from oddsmap.atomic_write.work_folder import put_back
from oddsmap.atomic_write.writer_lock import one_writer

__all__ = [
    "atomic_output",
    "atomic_outputs",
    "check_output",
    "one_writer",
    "put_back",
    "why_no_file",
]
