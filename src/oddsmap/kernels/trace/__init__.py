# SPDX-License-Identifier: Apache-2.0
"""Kernels of which cells a beam or a cone crosses."""
