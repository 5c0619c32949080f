# SPDX-License-Identifier: Apache-2.0
"""Files of maps, both ways, on arrays alone."""
