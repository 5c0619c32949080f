# SPDX-License-Identifier: Apache-2.0
"""Kernels of what cells are believed to be: likelihoods, messages, samples."""
