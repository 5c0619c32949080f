# SPDX-License-Identifier: Apache-2.0
"""From 3D maps to 2D ones."""
