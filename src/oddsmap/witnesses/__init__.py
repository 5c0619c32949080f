# SPDX-License-Identifier: Apache-2.0
"""Who said so: the scans and beams whose votes a cell has."""
