"""Constraints on the state: polyhedra, obstacles, and Signal Temporal Logic (in `stl`)."""

from ensemble_ctrl.constraints.disc import Disc, DiscRegion
from ensemble_ctrl.constraints.obstacle import BigMBounds, Obstacle
from ensemble_ctrl.constraints.polygon import convex_cover, convex_pieces
from ensemble_ctrl.constraints.polyhedron import Polyhedron
from ensemble_ctrl.constraints.solid import Solid

__all__ = ["BigMBounds", "Disc", "DiscRegion", "Obstacle", "Polyhedron", "Solid", "convex_cover", "convex_pieces"]
