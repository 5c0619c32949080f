# SPDX-License-Identifier: Apache-2.0
"""All cells together: estimates that keep the beams, not the evidence."""
