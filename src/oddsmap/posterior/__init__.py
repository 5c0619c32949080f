# SPDX-License-Identifier: Apache-2.0
"""Posteriors: read-only views of the evidence."""
