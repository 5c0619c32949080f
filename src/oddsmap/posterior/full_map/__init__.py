# SPDX-License-Identifier: Apache-2.0
"""Full-map estimation: all cells together, from the forward sensor model."""
