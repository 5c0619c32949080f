# SPDX-License-Identifier: Apache-2.0
"""Maps that are larger than memory: saved ones read by parts, and new ones made by parts."""
