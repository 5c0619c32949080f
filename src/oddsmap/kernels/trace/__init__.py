# SPDX-License-Identifier: Apache-2.0
"""Kernels for which cells a beam or a cone crosses."""
