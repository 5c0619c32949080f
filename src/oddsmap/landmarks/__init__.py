# SPDX-License-Identifier: Apache-2.0
"""Landmark maps: point landmarks seen from known poses, one Gaussian each."""

from oddsmap.landmarks.landmark import Landmark
from oddsmap.landmarks.landmark_map import LandmarkMap
from oddsmap.landmarks.observations import Observations
from oddsmap.landmarks.table import ObservationTable, read_observations

__all__ = ["Landmark", "LandmarkMap", "ObservationTable", "Observations", "read_observations"]
