"""Starts the node: ``ros2 launch scenegate_ros2 scenegate.launch.py [params_file:=FILE] [namespace:=NAME]``."""

from pathlib import Path

from ament_index_python.packages import get_package_share_directory
from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node


def generate_launch_description() -> LaunchDescription:
    """Return the node with its parameters."""
    defaults = Path(get_package_share_directory("scenegate_ros2")) / "config" / "scenegate.yaml"
    return LaunchDescription(
        [
            DeclareLaunchArgument("params_file", default_value=str(defaults)),
            DeclareLaunchArgument("namespace", default_value=""),
            Node(
                package="scenegate_ros2",
                executable="scenegate",
                namespace=LaunchConfiguration("namespace"),
                parameters=[LaunchConfiguration("params_file")],
                output="screen",
            ),
        ]
    )
