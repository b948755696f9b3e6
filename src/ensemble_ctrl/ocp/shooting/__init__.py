"""Plans for fleets that follow a differential equation: multiple shooting at the Gauss-node robots.

The decision vector holds the broadcast commands and the states of the Gauss-node robots at every grid time; each step's
integration is a constraint.  Everything else is as for robots on arcs: rows on points of the fleet, separating planes
fixed for a round, levels for the task.
"""
