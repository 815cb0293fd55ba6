"""Two arms of boxes before a camera, as several tests render them."""

import numpy as np
from pydrake.geometry import Box, Cylinder
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import FixedOffsetFrame, RevoluteJoint, SpatialInertia
from pydrake.systems.sensors import CameraInfo

from crossmodal.maths.pinhole import Intrinsics

WIDTH, HEIGHT, FOCAL = 320, 240, 290.0
INTRINSICS = Intrinsics(
    width=WIDTH, height=HEIGHT, focal_x=FOCAL, focal_y=FOCAL, center_x=159.5, center_y=119.5
)
RENDERED = CameraInfo(WIDTH, HEIGHT, FOCAL, FOCAL, 160.0, 120.0)
# The camera looks along the world's x, from before the arms.
X_WC = RigidTransform(RotationMatrix([[0, 0, 1], [-1, 0, 0], [0, -1, 0]]), [-1.0, 0.0, 0.0])
BASES = {"left": np.array([0.0, 0.25, -0.25]), "right": np.array([0.0, -0.25, -0.25])}
Q = {"left": np.array([0.3, -0.9]), "right": np.array([-0.25, 0.8])}


def build(moved: dict[str, RigidTransform], hands: float = 0.0):
    """Adds two arms of a post, two links and a hand with one finger."""

    def add(plant: MultibodyPlant) -> None:
        inertia = SpatialInertia.SolidCubeWithDensity(1.0, 0.1)
        for name, p in BASES.items():
            arm, hand = (
                plant.AddModelInstance(f"{name}_arm"),
                plant.AddModelInstance(f"{name}_hand"),
            )
            X_WBase = RigidTransform(p) @ moved.get(name, RigidTransform())
            bodies = [plant.AddRigidBody(link, arm, inertia) for link in ("base", "one", "two")]
            palm = plant.AddRigidBody("palm", hand, inertia)
            finger = plant.AddRigidBody("finger", hand, inertia)
            plant.WeldFrames(plant.world_frame(), bodies[0].body_frame(), X_WBase)
            up = RigidTransform([0.0, 0.0, 0.2])
            x = np.array([1.0, 0.0, 0.3]) / np.linalg.norm([1.0, 0.0, 0.3])
            for joint, below, above in (("first", 0, 1), ("second", 1, 2)):
                frame = plant.AddFrame(
                    FixedOffsetFrame(f"{joint}_at", bodies[below].body_frame(), up)
                )
                plant.AddJoint(RevoluteJoint(joint, frame, bodies[above].body_frame(), x))
            plant.WeldFrames(bodies[2].body_frame(), palm.body_frame(), up)
            plant.AddJoint(RevoluteJoint("knuckle", palm.body_frame(), finger.body_frame(), x))
            plant.AddFrame(FixedOffsetFrame("tip", palm.body_frame(), RigidTransform()))
            middle = RigidTransform(RotationMatrix.MakeZRotation(0.4), [0.0, 0.0, 0.1])
            shapes = (Box(0.1, 0.1, 0.19), Cylinder(0.05, 0.19), Box(0.08, 0.06, 0.17))
            for body, shape in zip(bodies, shapes, strict=True):
                plant.RegisterVisualGeometry(body, middle, shape, "shape", np.ones(4))
            plant.RegisterVisualGeometry(palm, middle, Box(0.09, 0.09, 0.06), "shape", np.ones(4))
            spread = RigidTransform([0.0, 0.0, 0.2 + hands])
            plant.RegisterVisualGeometry(finger, spread, Box(0.05, 0.05, 0.1), "s", np.ones(4))

    return add
