"""Installs the node where ``ros2 run`` and ``ros2 launch`` find it."""

from setuptools import setup

NAME = "scenegate_ros2"

setup(
    name=NAME,
    version="0.1.0",
    packages=[NAME],
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{NAME}"]),
        (f"share/{NAME}", ["package.xml"]),
        (f"share/{NAME}/launch", ["launch/scenegate.launch.py"]),
        (f"share/{NAME}/config", ["config/scenegate.yaml"]),
    ],
    install_requires=["setuptools"],
    zip_safe=True,
    maintainer="The Scenegate developers",
    license="Apache-2.0",
    description="Publishes the stereo camera and the live scene of a Scenegate server.",
    entry_points={"console_scripts": [f"scenegate = {NAME}.node:main"]},
)
