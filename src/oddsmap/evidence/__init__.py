# SPDX-License-Identifier: Apache-2.0
"""The map as data: tiles of hits and passes, in memory and on disk."""
