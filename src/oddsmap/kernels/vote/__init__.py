# SPDX-License-Identifier: Apache-2.0
"""Kernels of whose votes cells get: evidence from what was traced."""
