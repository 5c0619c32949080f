# SPDX-License-Identifier: Apache-2.0
"""Small worlds to try things in, and sensors that look at them.

In 2D a floor plan, an office, a drive through it and a camera that looks down on it; in
space a town for a lidar on a car and a room for a depth camera.

Example:
    >>> plan, lidar, rng = office_plan(), Lidar2D(), np.random.default_rng(0)
    >>> scans = (lidar.scan(plan, pose, rng) for pose in office_drive())
    >>> write_carmen("office.log.gz", scans)
"""

from oddsmap.simulate.carmen_writer import write_carmen
from oddsmap.simulate.depth_camera import DepthCamera
from oddsmap.simulate.floor_plan import FloorPlan
from oddsmap.simulate.glass import GlassScene, GlassSensor, glass_path, glass_scene
from oddsmap.simulate.lidar2d import Lidar2D
from oddsmap.simulate.lidar3d import Lidar3D
from oddsmap.simulate.office import office_drive, office_plan
from oddsmap.simulate.overhead import OverheadCamera
from oddsmap.simulate.room import room, room_walk
from oddsmap.simulate.shapes import Disc, Polygon, Rectangle, Shape, walls_around
from oddsmap.simulate.solids import Box, Cylinder, Ground, Solid
from oddsmap.simulate.sonar2d import Sonar2D
from oddsmap.simulate.town import drive3d, town
from oddsmap.simulate.traffic import Mover, MovingWorld, traffic
from oddsmap.simulate.world3d import World3D

__all__ = [
    "Box",
    "Cylinder",
    "DepthCamera",
    "Disc",
    "FloorPlan",
    "GlassScene",
    "GlassSensor",
    "Ground",
    "Lidar2D",
    "Lidar3D",
    "Mover",
    "MovingWorld",
    "OverheadCamera",
    "Polygon",
    "Rectangle",
    "Shape",
    "Solid",
    "Sonar2D",
    "World3D",
    "drive3d",
    "glass_path",
    "glass_scene",
    "office_drive",
    "office_plan",
    "room",
    "room_walk",
    "town",
    "traffic",
    "walls_around",
    "write_carmen",
]
