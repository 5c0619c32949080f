# SPDX-License-Identifier: Apache-2.0
"""A small world to try things in: floor plan, lidar, an office and a drive through it.

Example:
    >>> plan, lidar, rng = office_plan(), Lidar2D(), np.random.default_rng(0)
    >>> scans = (lidar.scan(plan, pose, rng) for pose in office_drive())
    >>> write_carmen("office.log.gz", scans)
"""

from oddsmap.simulate.carmen_writer import write_carmen
from oddsmap.simulate.floor_plan import FloorPlan
from oddsmap.simulate.lidar2d import Lidar2D
from oddsmap.simulate.office import office_drive, office_plan
from oddsmap.simulate.shapes import Disc, Polygon, Rectangle, Shape, walls_around

__all__ = [
    "Disc",
    "FloorPlan",
    "Lidar2D",
    "Polygon",
    "Rectangle",
    "Shape",
    "office_drive",
    "office_plan",
    "walls_around",
    "write_carmen",
]
