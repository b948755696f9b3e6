"""``ros2 launch ensemble_ctrl_ros online.launch.py problem:=/path/to/problem.yaml``."""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node


def generate_launch_description() -> LaunchDescription:
    """One node that replans."""
    problem = LaunchConfiguration("problem")
    return LaunchDescription(
        [
            DeclareLaunchArgument("problem", description="A problem file with a section online"),
            Node(package="ensemble_ctrl_ros", executable="online", parameters=[{"problem": problem}], output="screen"),
        ]
    )
