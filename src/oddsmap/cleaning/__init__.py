# SPDX-License-Identifier: Apache-2.0
"""What moved, taken out: of point clouds and of maps."""
