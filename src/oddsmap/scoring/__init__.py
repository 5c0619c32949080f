# SPDX-License-Identifier: Apache-2.0
"""How good a map is, and the sensor model behind it: with ground truth, and without."""
