# SPDX-License-Identifier: Apache-2.0
"""Sensors: the geometry of their beams, and the models p(x | z) of what a reading says."""
