# SPDX-License-Identifier: Apache-2.0
"""Questions about maps, in metres: what is at a point, and what does a ray meet."""
