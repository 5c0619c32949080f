# SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

import importlib.util

# Recordings are written and read with rosbags, an extra: pip install "oddsmap[ros]".
collect_ignore_glob = [] if importlib.util.find_spec("rosbags") else ["test_*.py"]
