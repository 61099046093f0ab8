"""Reads files that the operator or a client names: glTF scenes, mesh files, ROS packages and light rigs."""
