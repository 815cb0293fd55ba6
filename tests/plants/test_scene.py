"""The simulated world: kinematics of the arm, the object where it was asked for, its friction."""

from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose
from pydrake.geometry import GeometryId, Role
from pydrake.math import RigidTransform, RollPitchYaw
from pydrake.multibody.plant import MultibodyPlant
from pydrake.systems.framework import DiagramBuilder

from crossmodal.models import SDF_DIR
from crossmodal.plants.robots.arm_with_hand import add_robot, hand_load, make_arm_with_load
from crossmodal.plants.robots.wam import ARM_JOINTS, WAM_WITH_SOFT_HAND
from crossmodal.plants.scene import (
    ManipulationScene,
    ObjectPlacement,
    PlantConfig,
    add_manipulation_scene,
    facing,
)

# Barrett WAM with seven joints, standard Denavit-Hartenberg (a [m], alpha [deg], d [m]).
WAM = [
    (0.0, -90, 0.0),
    (0.0, 90, 0.0),
    (0.045, -90, 0.55),
    (-0.045, 90, 0.0),
    (0.0, -90, 0.3),
    (0.0, 90, 0.0),
    (0.0, 0, 0.06),
]


def denavit_hartenberg(a: float, alpha: float, d: float, theta: float) -> np.ndarray:
    ct, st = np.cos(theta), np.sin(theta)
    ca, sa = np.cos(np.deg2rad(alpha)), np.sin(np.deg2rad(alpha))
    return np.array(
        [
            [ct, -st * ca, st * sa, a * ct],
            [st, ct * ca, -ct * sa, a * st],
            [0, sa, ca, d],
            [0, 0, 0, 1],
        ]
    )


def make_scene(**placement: object) -> ManipulationScene:
    values: dict = {"model": SDF_DIR / "chest_drawer.sdf", "X_WO": RigidTransform([0.9, 0, 0.9])}
    objects = {"object": ObjectPlacement(**(values | placement))}
    return add_manipulation_scene(DiagramBuilder(), PlantConfig(), objects, [("arm", "hand")])


def test_the_arm_has_the_kinematics_of_the_wam() -> None:
    arm = make_arm_with_load(WAM_WITH_SOFT_HAND, RigidTransform())
    context = arm.CreateDefaultContext()
    q = np.random.default_rng(0).uniform(-1.0, 1.0, 7)
    arm.SetPositions(context, q)
    expected = np.eye(4)
    for (a, alpha, d), theta in zip(WAM, q, strict=True):
        expected = expected @ denavit_hartenberg(a, alpha, d, theta)
    actual = arm.GetFrameByName("tool_plate").CalcPoseInWorld(context).GetAsMatrix4()
    assert_allclose(actual, expected, atol=1e-9)


def test_the_robot_knows_the_arm_that_is_simulated() -> None:
    scene = make_scene()
    arm = make_arm_with_load(WAM_WITH_SOFT_HAND, scene.pose("base", "arm"))
    q = np.random.default_rng(1).uniform(-1.0, 1.0, 7)
    context, known = scene.plant.CreateDefaultContext(), arm.CreateDefaultContext()
    scene.plant.SetPositions(context, scene.model("arm"), q)
    arm.SetPositions(known, q)
    for frame in ("end_effector", "sensor"):
        assert_allclose(
            arm.GetFrameByName(frame).CalcPoseInWorld(known).GetAsMatrix4(),
            scene.plant.GetFrameByName(frame).CalcPoseInWorld(context).GetAsMatrix4(),
            atol=1e-9,
        )
    hand_mass = scene.plant.CalcTotalMass(context, [scene.model("hand")])
    assert_allclose(hand_load(arm)[0], hand_mass)
    assert [arm.GetJointByName(name).position_start() for name in ARM_JOINTS] == list(range(7))


def test_the_object_stands_where_it_was_asked_for() -> None:
    X_WO = RigidTransform(RollPitchYaw(0, 0, 3.0), [0.8, 0.1, 0.9])
    scene = make_scene(X_WO=X_WO)
    handle = scene.plant.GetFrameByName("handle", scene.objects["object"])
    X_WHandle = handle.CalcPoseInWorld(scene.plant.CreateDefaultContext())
    assert_allclose((X_WO.inverse() @ X_WHandle).translation(), [0.07, 0, 0], atol=1e-12)


def test_a_free_object_starts_where_it_was_asked_for_and_only_its_own_joints_rub() -> None:
    X_WO = RigidTransform(RollPitchYaw(0, 0, 3.0), [0.8, 0.1, 0.9])
    scene = make_scene(X_WO=X_WO, free=True, friction=5.0)
    carcass = scene.plant.GetBodyByName("carcass", scene.objects["object"])
    X_WB = carcass.EvalPoseInWorld(scene.plant.CreateDefaultContext())
    assert_allclose(X_WB.GetAsMatrix4(), X_WO.GetAsMatrix4(), atol=1e-12)
    slide = scene.plant.GetJointByName("slide").velocity_start()
    assert np.flatnonzero(scene.friction).tolist() == [slide]


def test_the_hand_faces_the_object_with_its_fingers_along_the_bar() -> None:
    X_WE = facing(RigidTransform())
    assert_allclose(X_WE.rotation().col(2), [-1, 0, 0])
    assert_allclose(X_WE.rotation().col(1), [0, 1, 0])


def test_an_unknown_texture_lists_the_known_ones() -> None:
    with pytest.raises(ValueError, match=r"no texture 'velvet'.*birch"):
        make_scene(texture="velvet")


@pytest.mark.parametrize(
    ("model", "texture", "multiplied_by"),
    [
        ("chest_drawer.sdf", "plain_white", (1.0, 1.0, 1.0)),  # It would be brown.
        ("chest_drawer.sdf", "oak", (0.75, 0.6, 0.42)),
        ("tripod.sdf", "plain_white", (0.8, 0.8, 0.8)),
    ],
)
def test_paint_hides_the_colour_of_what_is_painted(
    model: str, texture: str, multiplied_by: tuple[float, ...]
) -> None:
    scene = make_scene(model=SDF_DIR / model, texture=texture)
    inspector = scene.scene_graph.model_inspector()
    painted = [
        properties
        for geometry in inspector.GetAllGeometryIds(Role.kPerception)
        if (properties := inspector.GetPerceptionProperties(geometry)) is not None
        and texture in str(properties.GetPropertyOrDefault("phong", "diffuse_map", ""))
    ]
    assert painted
    for properties in painted:
        color = properties.GetProperty("phong", "diffuse")
        assert_allclose([color.r(), color.g(), color.b()], multiplied_by)


TWO_ARMS = """
directives:
- add_model: {name: left, file: package://crossmodal/wam_arm.sdf}
- add_model: {name: left_hand, file: package://crossmodal/soft_hand.sdf}
- add_model: {name: right, file: package://crossmodal/wam_arm.sdf}
- add_model: {name: right_hand, file: package://crossmodal/soft_hand.sdf}
- add_weld: {parent: world, child: left::base, X_PC: {translation: [0, 0.4, 0.7]}}
- add_weld: {parent: left::tool_plate, child: left_hand::wrist}
- add_weld: {parent: world, child: right::base, X_PC: {translation: [0, -0.4, 0.7]}}
- add_weld: {parent: right::tool_plate, child: right_hand::wrist}
"""


@pytest.fixture
def two_arms_and_three_objects(tmp_path: Path) -> ManipulationScene:
    path = tmp_path / "two_arms.dmd.yaml"
    path.write_text(TWO_ARMS)
    chest, box = SDF_DIR / "chest_drawer.sdf", SDF_DIR / "cardboard_box.sdf"
    return add_manipulation_scene(
        DiagramBuilder(),
        PlantConfig(scene=str(path)),
        {
            "upper": ObjectPlacement(model=chest, X_WO=RigidTransform([1, 0, 1.2]), friction=3.0),
            "lower": ObjectPlacement(model=chest, X_WO=RigidTransform([1, 0, 0.6]), friction=4.0),
            "box": ObjectPlacement(model=box, X_WO=RigidTransform([1, 1, 0.7]), free=True),
        },
        [("left", "left_hand"), ("right", "right_hand")],
    )


def test_several_arms_and_objects_stand_in_one_scene(
    two_arms_and_three_objects: ManipulationScene,
) -> None:
    scene = two_arms_and_three_objects
    plant = scene.plant
    assert list(scene.objects) == ["upper", "lower", "box"]
    assert_allclose(scene.pose("base", "right").translation(), [0, -0.4, 0.7])
    between = scene.pose("handle", "upper").inverse() @ scene.pose("handle", "lower")
    assert_allclose(between.translation(), [0, 0, -0.6], atol=1e-12)
    slides = [plant.GetJointByName("slide", scene.model(name)) for name in ("upper", "lower")]
    assert_allclose([scene.friction[slide.velocity_start()] for slide in slides], [3.0, 4.0])
    assert np.count_nonzero(scene.friction) == 2


def test_a_robot_collides_with_the_other_robot_but_not_with_itself(
    two_arms_and_three_objects: ManipulationScene,
) -> None:
    plant = two_arms_and_three_objects.plant
    inspector = two_arms_and_three_objects.scene_graph.model_inspector()

    def shape(model: str, body: str) -> GeometryId:
        found = plant.GetBodyByName(body, plant.GetModelInstanceByName(model))
        return plant.GetCollisionGeometriesForBody(found)[0]

    palms = [shape(hand, "palm") for hand in ("left_hand", "right_hand")]
    assert not inspector.CollisionFiltered(*palms)
    assert inspector.CollisionFiltered(palms[0], shape("left", "link_3"))


def test_an_unknown_model_lists_the_known_ones() -> None:
    with pytest.raises(ValueError, match=r"no model named 'leg'.*arm, hand.*object"):
        make_scene().model("leg")


def test_a_name_that_is_taken_is_refused() -> None:
    placement = ObjectPlacement(model=SDF_DIR / "tripod.sdf", X_WO=RigidTransform())
    with pytest.raises(ValueError, match="already has a model named 'hand'"):
        add_manipulation_scene(DiagramBuilder(), PlantConfig(), {"hand": placement}, [])


def test_two_robots_are_added_under_names_of_their_own() -> None:
    plant = MultibodyPlant(0.0)
    for k, y in enumerate((0.5, -0.5)):
        add_robot(plant, WAM_WITH_SOFT_HAND, RigidTransform([0, y, 0]), f"arm_{k}", f"hand_{k}")
    plant.Finalize()
    wrist = plant.GetFrameByName("wrist", plant.GetModelInstanceByName("hand_1"))
    alone = make_arm_with_load(WAM_WITH_SOFT_HAND, RigidTransform([0, -0.5, 0]))
    assert_allclose(
        wrist.CalcPoseInWorld(plant.CreateDefaultContext()).translation(),
        alone.GetFrameByName("sensor").CalcPoseInWorld(alone.CreateDefaultContext()).translation(),
        atol=1e-9,
    )
