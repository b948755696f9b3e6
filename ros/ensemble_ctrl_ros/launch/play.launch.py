"""``ros2 launch ensemble_ctrl_ros play.launch.py plan:=/path/to/plans/office``."""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node


def generate_launch_description() -> LaunchDescription:
    """One node that plays a plan."""
    plan = LaunchConfiguration("plan")
    return LaunchDescription(
        [
            DeclareLaunchArgument("plan", description="A results folder of ensemble-plan"),
            Node(package="ensemble_ctrl_ros", executable="play", parameters=[{"plan": plan}], output="screen"),
        ]
    )
