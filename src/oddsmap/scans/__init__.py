# SPDX-License-Identifier: Apache-2.0
"""Measurements with their poses, and logs of them."""
