# SPDX-License-Identifier: Apache-2.0
"""Poses, and poses over time."""
