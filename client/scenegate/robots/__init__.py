"""Reads robot files (URDF, SDF): links with their geometry, joints, and the poses of links for joint values.

Functions append sentences about what is left out or repaired to the list ``warnings``.
"""

from scenegate.robots.robot import Joint as Joint
from scenegate.robots.robot import Robot as Robot
from scenegate.robots.robot_errors import RobotFileError as RobotFileError
from scenegate.robots.robot_reader import read_robot as read_robot
