"""Starts the node: ``ros2 launch scenegate_ros2 scenegate.launch.py [params_file:=FILE] [namespace:=NAME] [url:=…] …``.

Each parameter of the node is an argument, which takes precedence over the file.
"""

from pathlib import Path

from ament_index_python.packages import get_package_share_directory
from launch import LaunchContext, LaunchDescription
from launch.actions import DeclareLaunchArgument, OpaqueFunction
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue
from scenegate_ros2.parameters import NodeParameters

DEFAULTS = {**vars(NodeParameters()), "use_sim_time": False}


def generate_launch_description() -> LaunchDescription:
    """Return the arguments and the node."""
    defaults = Path(get_package_share_directory("scenegate_ros2")) / "config" / "scenegate.yaml"
    return LaunchDescription(
        [
            DeclareLaunchArgument("params_file", default_value=str(defaults)),
            DeclareLaunchArgument("namespace", default_value=""),
            *(DeclareLaunchArgument(name, default_value="") for name in DEFAULTS),
            OpaqueFunction(function=_nodes),
        ]
    )


def _nodes(context: LaunchContext) -> list[Node]:
    """Return the node with the parameters of the file and those that were given."""
    given = {
        name: ParameterValue(LaunchConfiguration(name), value_type=type(default))
        for name, default in DEFAULTS.items()
        if LaunchConfiguration(name).perform(context)
    }
    return [
        Node(
            package="scenegate_ros2",
            executable="scenegate",
            namespace=LaunchConfiguration("namespace"),
            parameters=[LaunchConfiguration("params_file"), given],
            output="screen",
        )
    ]
