"""A ROS 2 node that publishes Scenegate's stereo camera and live scene."""
