# SPDX-License-Identifier: Apache-2.0
"""Maps in the formats of other programs: ROS map_server files and NumPy archives."""
