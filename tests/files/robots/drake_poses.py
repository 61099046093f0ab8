"""Poses of the links of a URDF or SDF robot by pydrake, run by the interpreter SCENEGATE_DRAKE_PYTHON.

Reads a list of {"file", "packages": {name: folder}, "joints": {name: values}} in JSON from stdin; writes a list of
{link: 4x4 matrix}, or of the reason why Drake cannot read a file, to stdout.
"""

import json
import re
import sys
from pathlib import Path
from typing import Any

from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import BodyIndex


def link_poses(request: dict[str, Any]) -> dict[str, Any]:
    """Return the poses of a robot's links."""
    plant = MultibodyPlant(0.001)
    parser = Parser(plant)
    for name, folder in request["packages"].items():
        parser.package_map().Add(name, folder)
    path = Path(request["file"])
    if path.suffix == ".urdf":
        # Elements of Gazebo and ROS have nothing to do with the kinematics, and Drake refuses some of them.
        text = re.sub(r"<(transmission|gazebo)\b.*?</\1>", "", path.read_text(), flags=re.DOTALL)
        parser.AddModelsFromString(text, "urdf")
    else:
        parser.AddModels(str(path))
    plant.Finalize()
    context = plant.CreateDefaultContext()
    q = plant.GetPositions(context)
    for index in plant.GetJointIndices():
        joint = plant.get_joint(index)
        values = request["joints"].get(joint.name(), ())
        if joint.num_positions() == len(values):
            q[joint.position_start() : joint.position_start() + len(values)] = values
    plant.SetPositions(context, q)
    bodies = [plant.get_body(index) for index in map(BodyIndex, range(plant.num_bodies()))]
    return {body.name(): plant.EvalBodyPoseInWorld(context, body).GetAsMatrix4().tolist() for body in bodies}


results = []
for request in json.load(sys.stdin):
    try:
        results.append(link_poses(request))
    except RuntimeError as error:
        results.append({"error": str(error)})
json.dump(results, sys.stdout)
