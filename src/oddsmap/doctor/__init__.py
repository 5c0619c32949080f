# SPDX-License-Identifier: Apache-2.0
"""What is wrong with a log, measured: each suspicion by how well maps predict held-out beams."""
