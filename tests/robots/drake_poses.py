"""Poses of a URDF robot's links by pydrake, run by the interpreter SCENEGATE_DRAKE_PYTHON.

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


def link_poses(request: dict[str, Any]) -> dict[str, Any]:
    """Return the poses of a robot's links."""
    plant = MultibodyPlant(0.001)
    parser = Parser(plant)
    for name, folder in request["packages"].items():
        parser.package_map().Add(name, folder)
    # Elements of Gazebo and ROS have nothing to do with the kinematics, and Drake refuses some of them.
    text = re.sub(r"<(transmission|gazebo)\b.*?</\1>", "", Path(request["file"]).read_text(), flags=re.DOTALL)
    (model,) = parser.AddModelsFromString(text, "urdf")
    plant.Finalize()
    context = plant.CreateDefaultContext()
    q = plant.GetPositions(context)
    for index in plant.GetJointIndices(model):
        joint = plant.get_joint(index)
        values = request["joints"].get(joint.name(), ())
        if joint.num_positions() == len(values):
            q[joint.position_start() : joint.position_start() + len(values)] = values
    plant.SetPositions(context, q)
    bodies = [plant.get_body(index) for index in plant.GetBodyIndices(model)]
    return {body.name(): plant.EvalBodyPoseInWorld(context, body).GetAsMatrix4().tolist() for body in bodies}


results = []
for request in json.load(sys.stdin):
    try:
        results.append(link_poses(request))
    except RuntimeError as error:
        results.append({"error": str(error)})
json.dump(results, sys.stdout)
