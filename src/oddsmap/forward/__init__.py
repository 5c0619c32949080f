# SPDX-License-Identifier: Apache-2.0
"""The forward model p(z | map, pose): for full maps, scores, exact posteriors and simulation."""
