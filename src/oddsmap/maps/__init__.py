# SPDX-License-Identifier: Apache-2.0
"""Maps without counts: grids of probabilities and of voxels."""
