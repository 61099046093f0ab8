"""Runs in an interpreter with pydrake: simulates, publishes over LCM, and prints what must be seen.

    python drake_publisher.py URL [SECONDS]

The last line is a JSON object with the poses, contacts and vertices of the last messages. With SECONDS the simulation
runs at real time for that long.
"""

import json
import sys
from typing import Any

import numpy as np
from drake import lcmt_point_cloud, lcmt_point_cloud_field, lcmt_viewer_draw
from pydrake.common import MemoryFile
from pydrake.geometry import (
    AddCompliantHydroelasticProperties,
    AddContactMaterial,
    AddRigidHydroelasticProperties,
    Box,
    GeometryInstance,
    InMemoryMesh,
    MakePhongIllustrationProperties,
    Mesh,
    ProximityProperties,
    Sphere,
)
from pydrake.lcm import DrakeLcm
from pydrake.math import RigidTransform
from pydrake.multibody.fem import DeformableBodyConfig
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import AddMultibodyPlant, CoulombFriction, MultibodyPlantConfig
from pydrake.multibody.tree import BodyIndex, SpatialInertia
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from pydrake.visualization import ApplyVisualizationConfig, VisualizationConfig

INERTIA = '<inertia ixx="0.01" iyy="0.01" izz="0.004" ixy="0" ixz="0" iyz="0"/>'
ARM = f"""<robot name="arm">
 <link name="base">
  <visual><geometry><cylinder radius="0.08" length="0.1"/></geometry>
   <material name="grey"><color rgba="0.4 0.4 0.45 1"/></material></visual>
  <inertial><mass value="2"/>{INERTIA}</inertial>
 </link>
 <link name="upper">
  <visual><origin xyz="0 0 0.2"/><geometry><capsule radius="0.05" length="0.3"/></geometry>
   <material name="orange"><color rgba="0.9 0.5 0.1 1"/></material></visual>
  <inertial><origin xyz="0 0 0.2"/><mass value="1"/>{INERTIA}</inertial>
 </link>
 <link name="fore">
  <visual><origin xyz="0 0 0.15"/><geometry><box size="0.06 0.06 0.3"/></geometry>
   <material name="blue"><color rgba="0.1 0.4 0.9 1"/></material></visual>
  <collision><origin xyz="0 0 0.15"/><geometry><box size="0.06 0.06 0.3"/></geometry></collision>
  <inertial><origin xyz="0 0 0.15"/><mass value="0.5"/>{INERTIA}</inertial>
 </link>
 <joint name="shoulder" type="revolute"><parent link="base"/><child link="upper"/><origin xyz="0 0 0.05"/>
  <axis xyz="0 1 0"/><limit lower="-3" upper="3" effort="100" velocity="9"/><dynamics damping="0.2"/></joint>
 <joint name="elbow" type="revolute"><parent link="upper"/><child link="fore"/><origin xyz="0 0 0.4"/>
  <axis xyz="0 1 0"/><limit lower="-3" upper="3" effort="100" velocity="9"/><dynamics damping="0.1"/></joint>
</robot>"""
OBJ = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"


def ball(plant: Any, name: str, radius: float, at: list[float], *, hydroelastic: bool) -> None:
    body = plant.AddRigidBody(name, plant.AddModelInstance(name), SpatialInertia.SolidSphereWithMass(1.0, radius))
    properties = ProximityProperties()
    AddContactMaterial(friction=CoulombFriction(0.5, 0.5), properties=properties)
    if hydroelastic:
        AddCompliantHydroelasticProperties(0.03, 1e5, properties)
    plant.RegisterCollisionGeometry(body, RigidTransform(), Sphere(radius), "collision", properties)
    plant.RegisterVisualGeometry(body, RigidTransform(), Sphere(radius), "visual", [0.9, 0.2, 0.2, 1.0])
    plant.SetDefaultFloatingBaseBodyPose(body, RigidTransform(at))


def main(url: str, seconds: float) -> None:
    builder = DiagramBuilder()
    config = MultibodyPlantConfig(
        time_step=0.002, contact_model="hydroelastic_with_fallback", discrete_contact_approximation="sap"
    )
    plant, _ = AddMultibodyPlant(config, builder)
    Parser(plant).AddModelsFromString(ARM, "urdf")
    plant.WeldFrames(plant.world_frame(), plant.GetFrameByName("base"), RigidTransform([0.0, -0.6, 0.05]))
    ground = ProximityProperties()
    AddContactMaterial(friction=CoulombFriction(0.5, 0.5), properties=ground)
    AddRigidHydroelasticProperties(1.0, ground)
    X_ground = RigidTransform([0.0, 0.0, -0.1])
    plant.RegisterCollisionGeometry(plant.world_body(), X_ground, Box(4.0, 4.0, 0.2), "ground", ground)
    plant.RegisterVisualGeometry(plant.world_body(), X_ground, Box(4.0, 4.0, 0.2), "ground", [0.6, 0.65, 0.6, 1.0])
    memory = InMemoryMesh(mesh_file=MemoryFile(OBJ, ".obj", "tetrahedron.obj"))
    mesh = Mesh(memory, [0.2, 0.2, 0.3])
    plant.RegisterVisualGeometry(
        plant.world_body(), RigidTransform([0.6, 0.6, 0.0]), mesh, "memory", [0.2, 0.8, 0.3, 1.0]
    )
    ball(plant, "soft", 0.12, [0.4, 0.0, 0.13], hydroelastic=True)
    ball(plant, "hard", 0.1, [0.8, 0.0, 0.11], hydroelastic=False)
    jelly = GeometryInstance(RigidTransform([-0.5, 0.2, 0.12]), Sphere(0.1), "jelly")
    properties = ProximityProperties()
    AddContactMaterial(friction=CoulombFriction(0.5, 0.5), properties=properties)
    jelly.set_proximity_properties(properties)
    jelly.set_illustration_properties(MakePhongIllustrationProperties([0.5, 0.2, 0.8, 1.0]))
    deformables = plant.mutable_deformable_model()
    jelly_id = deformables.RegisterDeformableBody(jelly, DeformableBodyConfig(), 0.06)
    plant.Finalize()

    lcm = DrakeLcm(url)
    ApplyVisualizationConfig(
        VisualizationConfig(enable_meshcat_creation=False, publish_period=1 / 64), builder, lcm=lcm
    )
    diagram = builder.Build()
    simulator = Simulator(diagram)
    context = simulator.get_mutable_context()
    plant_context = plant.GetMyMutableContextFromRoot(context)
    plant.SetPositions(plant_context, plant.GetModelInstanceByName("arm"), [0.4, 0.6])
    simulator.set_target_realtime_rate(1.0 if seconds else 0.0)
    simulator.Initialize()
    simulator.AdvanceTo(seconds or 0.25)
    diagram.ForcedPublish(context)

    found: dict[str, Any] = {"poses": {}}
    for index in range(1, plant.num_bodies()):
        body = plant.get_body(BodyIndex(index))
        model = plant.GetModelInstanceName(body.model_instance())
        X = plant.EvalBodyPoseInWorld(plant_context, body).GetAsMatrix4()
        found["poses"][f"{model}::{body.name()}"] = X.tolist()
    results = plant.get_contact_results_output_port().Eval(plant_context)
    found["points"] = [
        {
            "bodies": [plant.get_body(info.bodyA_index()).name(), plant.get_body(info.bodyB_index()).name()],
            "point": list(info.contact_point()),
            "force": list(info.contact_force()),
        }
        for info in (results.point_pair_contact_info(i) for i in range(results.num_point_pair_contacts()))
    ]
    found["surfaces"] = [
        {
            "centroid": list(info.contact_surface().centroid()),
            "force": list(info.F_Ac_W().translational()),
            "vertices": info.contact_surface().num_vertices(),
        }
        for info in (results.hydroelastic_contact_info(i) for i in range(results.num_hydroelastic_contacts()))
    ]
    q = plant_context.get_discrete_state(deformables.GetDiscreteStateIndex(jelly_id)).value()
    found["vertices"] = q[: len(q) // 3].reshape(-1, 3).tolist()

    cloud = lcmt_point_cloud()
    cloud.frame_name, cloud.width, cloud.height, cloud.num_fields = "world", 4, 1, 4
    for column, name in enumerate(("x", "y", "z", "rgb")):
        described = lcmt_point_cloud_field()
        described.name, described.byte_offset, described.count = name, 4 * column, 1
        described.datatype = described.UINT32 if name == "rgb" else described.FLOAT32
        cloud.fields.append(described)
    cloud.flags, cloud.point_step, cloud.row_step = cloud.IS_STRICTLY_FINITE, 16, 64
    points = np.zeros(4, [("xyz", "<f4", 3), ("rgb", "u1", 4)])
    points["xyz"] = [[0, 0, 1.0], [0.1, 0, 1.0], [0, 0.1, 1.0], [0, 0, 1.1]]
    points["rgb"][:, :3] = [[255, 0, 0], [0, 255, 0], [0, 0, 255], [51, 102, 153]]
    cloud.data = points.tobytes()
    cloud.data_size = len(cloud.data)
    lcm.Publish("DRAKE_POINT_CLOUD_TEST", cloud.encode())
    frames = lcmt_viewer_draw()
    frames.num_links, frames.link_name, frames.robot_num = 2, ["goal::a", "goal::b"], [0, 0]
    frames.position, frames.quaternion = [[0.0, 0.5, 1.0], [0.5, 0.5, 1.0]], [[1, 0, 0, 0], [0, 0, 0, 1]]
    lcm.Publish("DRAKE_DRAW_FRAMES", frames.encode())
    lcm.Publish("DRAKE_VIEWER_LOAD_ROBOT_PERCEPTION", b"not shown")
    print(json.dumps(found))


main(sys.argv[1], float(sys.argv[2]) if len(sys.argv) > 2 else 0.0)
