from numpy.testing import assert_allclose
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph
from pydrake.multibody.tree import FixedOffsetFrame, SpatialInertia
from pydrake.systems.framework import DiagramBuilder

from crossmodal.diagrams.stations.true_pose import add_true_pose


def test_a_frame_goes_with_its_body() -> None:
    builder = DiagramBuilder()
    plant, _ = AddMultibodyPlantSceneGraph(builder, time_step=0.01)
    body = plant.AddRigidBody("body", SpatialInertia.SolidSphereWithMass(1.0, 0.1))
    X_BF = RigidTransform(RotationMatrix.MakeXRotation(0.3), [0.1, 0.2, 0.3])
    frame = plant.AddFrame(FixedOffsetFrame("frame", body.body_frame(), X_BF))
    plant.Finalize()
    add_true_pose(builder, plant, frame, "thing")
    diagram = builder.Build()
    context = diagram.CreateDefaultContext()
    X_WB = RigidTransform(RotationMatrix.MakeZRotation(1.0), [1.0, 2.0, 3.0])
    plant.SetFloatingBaseBodyPoseInWorldFrame(
        plant.GetMyMutableContextFromRoot(context), body, X_WB
    )
    found = diagram.GetOutputPort("cheat_thing_pose").Eval(context)
    assert_allclose(found.GetAsMatrix4(), (X_WB @ X_BF).GetAsMatrix4(), atol=1e-12)
