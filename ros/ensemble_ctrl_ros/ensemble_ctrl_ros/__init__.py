"""Nodes that play a plan of `ensemble_ctrl`, or replan online; what they decide is in `broadcast`, without ROS."""
