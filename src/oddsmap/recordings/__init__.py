# SPDX-License-Identifier: Apache-2.0
"""Recordings of robots: topics, transforms, and the scans and poses in them."""
