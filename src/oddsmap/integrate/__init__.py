# SPDX-License-Identifier: Apache-2.0
"""Scans to evidence: the mapping itself."""
