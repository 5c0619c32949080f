# SPDX-License-Identifier: Apache-2.0
"""Kernels for what is believed about cells: likelihoods, messages, samples."""
