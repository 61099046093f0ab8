"""Files that the operator or a client names: glTF scenes, mesh files of all formats, ROS packages and light rigs."""
