"""Models as they are found in the wild: what is converted, what is refused, and how it is said."""

from collections.abc import Callable
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
import trimesh
from numpy.testing import assert_allclose
from pydrake.geometry import Mesh
from pydrake.math import RotationMatrix
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph, MultibodyPlant
from pydrake.systems.framework import DiagramBuilder
from wild_models import box, write_cabinet, write_chest, write_door

from crossmodal.models import SDF_DIR
from crossmodal.plants.object_import.object_import import ImportedObject, import_object

BOX = "<geometry><box size='0.1 0.1 0.1'/></geometry>"


def read(imported: ImportedObject) -> MultibodyPlant:
    """The written model, its root on the world."""
    plant, _ = AddMultibodyPlantSceneGraph(DiagramBuilder(), 0.001)
    (instance,) = Parser(plant).AddModels(str(imported.model))
    plant.WeldFrames(plant.world_frame(), plant.GetFrameByName("__model__", instance))
    plant.Finalize()
    return plant


def urdf(folder: Path, body: str) -> Path:
    path = folder / "model.urdf"
    path.write_text(f"<robot name='m'>{body}</robot>")
    return path


def slider(link: str, joint: str = "<limit lower='0' upper='1'/>") -> str:
    return (
        f"<link name='a'/>{link}<joint name='j' type='prismatic'><parent link='a'/>"
        f"<child link='b'/><axis xyz='1 0 0'/>{joint}</joint>"
    )


def refusal(path: Path, folder: Path, frame: str = "b", joint: str = "") -> str:
    with pytest.raises(ValueError, match=r".") as caught:
        import_object(path, folder / "out", grasp_frame=frame, joint=joint)
    assert "\n" not in str(caught.value)
    return str(caught.value)


@pytest.mark.parametrize(
    ("write", "frame", "joint", "travel"),
    [
        (write_door, "grip", "hinge", (-np.inf, np.inf)),
        (write_cabinet, "upper_grip", "upper", (0.0, 0.35)),
        (write_chest, "grip", "lid_hinge", (-1.5, 0.0)),
    ],
)
def test_a_wild_model_becomes_one_self_contained_model_with_its_own_names(
    write: Callable[[Path], Path], frame: str, joint: str, travel: tuple, tmp_path: Path
) -> None:
    source = write(tmp_path / "wild")
    imported = import_object(source, tmp_path / "out", grasp_frame=frame)
    assert imported.joint == joint
    (tmp_path / "wild").rename(tmp_path / "gone")
    plant = read(imported)
    found = plant.GetJointByName(joint)
    limits = found.position_lower_limits()[0], found.position_upper_limits()[0]
    assert_allclose(limits, travel)
    assert plant.HasFrameNamed(imported.grasp_frame)
    assert all(len(line) < 120 and "\n" not in line for line in imported.warnings)


def test_an_imported_model_is_imported_again_as_it_is(tmp_path: Path) -> None:
    first = import_object(write_cabinet(tmp_path), tmp_path / "out", grasp_frame="upper_grip")
    again = import_object(
        first.model, tmp_path / "again", grasp_frame=first.grasp_frame, joint=first.joint
    )
    assert again.model == first.model
    assert again.warnings == []
    assert (again.joint, again.grasp_frame) == (first.joint, first.grasp_frame)


def test_the_same_model_gives_the_same_copy(tmp_path: Path) -> None:
    source = write_cabinet(tmp_path)
    copies = [
        import_object(source, tmp_path / name, grasp_frame="upper_grip").model.parent
        for name in ("one", "two")
    ]
    files = [sorted(path.relative_to(copy) for path in copy.rglob("*.*")) for copy in copies]
    assert files[0] == files[1]
    assert all((copies[0] / f).read_bytes() == (copies[1] / f).read_bytes() for f in files[0])


def test_meshes_of_every_kind_keep_their_size_and_place(tmp_path: Path) -> None:
    cabinet = import_object(write_cabinet(tmp_path), tmp_path / "out", grasp_frame="upper_grip")
    door = import_object(write_door(tmp_path / "d"), tmp_path / "door", grasp_frame="grip")
    assert any("m large, so meshes without a <scale> are" in line for line in door.warnings)
    expected = {
        "case": ([-0.41, -0.23, -0.25], [-0.01, 0.23, 0.25]),  # Centimetres in COLLADA.
        "upper": ([0.0, -0.205, -0.1], [0.097, 0.205, 0.1]),  # glTF, y-up.
        "leaf": ([0.0, 0.0, -0.2], [0.097, 0.36, 0.2]),  # Millimetres in STL.
    }
    for imported, names in ((cabinet, ("case", "upper")), (door, ("leaf",))):
        plant, scene_graph = AddMultibodyPlantSceneGraph(DiagramBuilder(), 0.001)
        Parser(plant).AddModels(str(imported.model))
        inspector = scene_graph.model_inspector()
        for name in names:
            link = next(
                body
                for index in plant.GetBodyIndices(plant.GetModelInstanceByName("object"))
                if (body := plant.get_body(index)).name().split(".")[-1] == name
            )
            (shape,) = plant.GetCollisionGeometriesForBody(link)
            assert isinstance(inspector.GetShape(shape), Mesh)
            hull = inspector.GetConvexHull(shape)
            vertices = np.array([hull.vertex(i) for i in range(hull.num_vertices())])
            assert_allclose(vertices.min(axis=0), expected[name][0], atol=2e-3)
            assert_allclose(vertices.max(axis=0), expected[name][1], atol=2e-3)


def test_missing_and_impossible_inertias_come_from_the_geometry(tmp_path: Path) -> None:
    box_link = (
        "<link name='b'><inertial><mass value='{}'/><inertia ixx='1' iyy='0.1' izz='0.1' ixy='0'"
        " ixz='0' iyz='0'/></inertial><collision><origin xyz='0.3 0 0'/>" + BOX + "</collision>"
        "</link>"
    )
    for mass, expected in (("2", 2.0), ("0", 0.6), ("-1", 0.6)):
        path = urdf(tmp_path, slider(box_link.format(mass)))
        imported = import_object(path, tmp_path / f"out{mass}", grasp_frame="b")
        inertia = read(imported).GetBodyByName("b").default_spatial_inertia()
        assert_allclose(inertia.get_mass(), expected)
        assert_allclose(inertia.get_com(), [0.3, 0, 0], atol=1e-12)
        assert inertia.IsPhysicallyValid()


def test_a_possible_inertia_and_a_given_friction_are_kept(tmp_path: Path) -> None:
    path = tmp_path / "m.sdf"
    path.write_text(
        "<sdf version='1.9'><model name='m'><link name='a'/><link name='b'><inertial><pose>0.1 0 0"
        " 0 0 0</pose><mass>3</mass><inertia><ixx>0.1</ixx><iyy>0.2</iyy><izz>0.25</izz><ixy>0.01"
        "</ixy></inertia></inertial><collision name='c'><geometry><sphere><radius>0.1</radius>"
        "</sphere></geometry><surface><friction><ode><mu>0.3</mu></ode></friction></surface>"
        "</collision></link><joint name='j' type='prismatic'><parent>a</parent><child>b</child>"
        "<axis><xyz>0 1 0</xyz></axis></joint></model></sdf>"
    )
    imported = import_object(path, tmp_path / "out", grasp_frame="b")
    inertia = read(imported).GetBodyByName("b").default_spatial_inertia()
    central = inertia.Shift(inertia.get_com()).CalcRotationalInertia()
    assert_allclose(central.get_moments(), [0.1, 0.2, 0.25])
    assert_allclose(central.get_products()[0], 0.01)
    assert "<drake:mu_static>0.3<" in imported.model.read_text()


@pytest.mark.parametrize("declared", ["", " xmlns:drake='http://drake.mit.edu'"])
def test_drakes_own_elements_are_kept_however_they_are_declared(
    declared: str, tmp_path: Path
) -> None:
    path = tmp_path / "m.sdf"
    path.write_text(
        f"<sdf version='1.9'{declared}><model name='m'><link name='a'/><link name='b'>"
        "<collision name='c'><geometry><sphere><radius>0.1</radius></sphere></geometry>"
        "<drake:proximity_properties><drake:mu_static>0.7</drake:mu_static><drake:mu_dynamic>0.6"
        "</drake:mu_dynamic></drake:proximity_properties></collision></link>"
        "<joint name='j' type='prismatic'><parent>a</parent><child>b</child><axis><xyz>0 1 0</xyz>"
        "</axis></joint></model></sdf>"
    )
    imported = import_object(path, tmp_path / "out", grasp_frame="b")
    assert "<drake:mu_static>0.7<" in imported.model.read_text()


def test_what_moves_with_the_grasp_and_every_mesh_becomes_rigid_hydroelastic(
    tmp_path: Path,
) -> None:
    imported = import_object(write_cabinet(tmp_path), tmp_path / "out", grasp_frame="upper_grip")
    collisions = list(ElementTree.parse(imported.model).iter("collision"))
    rigid = [c for c in collisions if "rigid_hydroelastic" in ElementTree.tostring(c, "unicode")]
    meshes = [c for c in collisions if c.find("geometry/mesh") is not None]
    assert len(meshes) == len(rigid) == 3


def test_the_models_frame_stands_on_the_root(tmp_path: Path) -> None:
    imported = import_object(write_door(tmp_path), tmp_path / "out", grasp_frame="grip")
    plant = MultibodyPlant(0.0)
    (instance,) = Parser(plant).AddModels(str(imported.model))
    assert plant.GetFrameByName("__model__", instance).body().name() == "case"


def test_mimic_joints_and_springs_stay(tmp_path: Path) -> None:
    chest = import_object(write_chest(tmp_path), tmp_path / "out", grasp_frame="grip")
    assert chest.is_floating
    assert '<drake:mimic joint="lid_hinge" multiplier="0.5" offset="0.0"' in chest.model.read_text()


def test_of_several_moving_joints_the_nearest_is_explored_and_others_can_be(tmp_path: Path) -> None:
    source = write_cabinet(tmp_path)
    nearest = import_object(source, tmp_path / "one", grasp_frame="tray")
    assert nearest.joint == "tray_slide"
    assert any("tray_slide, lower" in line for line in nearest.warnings)
    assert (
        import_object(source, tmp_path / "two", grasp_frame="tray", joint="lower").joint == "lower"
    )
    message = refusal(source, tmp_path, "tray", "upper")
    assert "joint 'upper' does not move 'tray'; those that do: tray_slide, lower" in message


def test_a_pose_in_a_link_serves_as_the_grasped_frame(tmp_path: Path) -> None:
    path = urdf(tmp_path, slider("<link name='b'/>"))
    imported = import_object(path, tmp_path / "out", grasp_frame="b@0.1,0.2,0.3,0,0,1.5")
    plant = read(imported)
    pose = plant.GetFrameByName(imported.grasp_frame).CalcPoseInWorld(plant.CreateDefaultContext())
    assert_allclose(pose.translation(), [0.1, 0.2, 0.3])
    assert_allclose(pose.rotation().ToRollPitchYaw().vector(), [0, 0, 1.5], atol=1e-12)
    assert "x,y,z,roll,pitch,yaw" in refusal(path, tmp_path, "b@0.1,0.2")


def test_names_are_listed_where_one_is_missing_or_unknown(tmp_path: Path) -> None:
    source = write_cabinet(tmp_path)
    for frame in ("", "knob"):
        message = refusal(source, tmp_path, frame)
        assert "upper_grip, " in message
        assert "tray" in message
    assert "no prismatic or revolute joint with travel moves 'case'" in refusal(
        source, tmp_path, "case"
    )


def test_infinite_limits_are_none(tmp_path: Path) -> None:
    for number, limit in enumerate(("lower='-inf' upper='inf'", "lower='-1e16' upper='1e16'", "")):
        path = urdf(tmp_path, slider("<link name='b'/>", f"<limit {limit} effort='1'/>"))
        imported = import_object(path, tmp_path / str(number), grasp_frame="b")
        assert np.all(np.isinf(read(imported).GetJointByName("j").position_upper_limits()))
    assert "joint 'j': 'far' must be a number" in refusal(
        urdf(tmp_path, slider("<link name='b'/>", "<limit lower='0' upper='far'/>")), tmp_path
    )


def test_meshes_inside_out_and_open_meshes_have_a_mass(tmp_path: Path) -> None:
    reversed_box = box([0.1, 0.1, 0.1], [0, 0, 0])
    reversed_box.invert()
    reversed_box.export(tmp_path / "reversed.stl")
    opened = box([0.1, 0.1, 0.1], [0, 0, 0])
    opened.update_faces(np.arange(12) > 1)
    opened.export(tmp_path / "open.stl")
    trimesh.Trimesh([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]]).export(tmp_path / "flat.stl")
    for name, mass in (("reversed", 0.6), ("open", 0.15), ("flat", 0.0)):
        mesh = f"<geometry><mesh filename='{name}.stl'/></geometry>"
        path = urdf(tmp_path, slider(f"<link name='b'><visual>{mesh}</visual></link>"))
        imported = import_object(path, tmp_path / name, grasp_frame="b")
        actual = read(imported).GetBodyByName("b").default_mass()
        assert_allclose(actual, mass, rtol=1e-5, atol=0.01)


def test_packages_are_found_by_their_environment_variable(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "elsewhere" / "parts").mkdir(parents=True)
    box([0.1, 0.1, 0.1], [0, 0, 0]).export(tmp_path / "elsewhere" / "parts" / "b.stl")
    mesh = "<geometry><mesh filename='package://parts/b.stl' scale='2 1 1'/></geometry>"
    path = urdf(tmp_path, slider(f"<link name='b'><visual>{mesh}</visual></link>"))
    assert "<mesh> 'package://parts/b.stl': there is no such file" in refusal(path, tmp_path)
    monkeypatch.setenv("ROS_PACKAGE_PATH", str(tmp_path / "elsewhere"))
    imported = import_object(path, tmp_path / "out", grasp_frame="b")
    assert_allclose(read(imported).GetBodyByName("b").default_mass(), 600 * 0.002)


def test_a_joint_without_travel_holds_what_hangs_on_it_fixed(tmp_path: Path) -> None:
    base = (
        "<link name='base'/><joint name='w' type='revolute'><parent link='base'/>"
        "<child link='a'/><axis xyz='0 1 0'/><limit lower='0.5' upper='0.5'/></joint>"
    )
    link = f"<link name='b'><collision>{BOX}</collision></link>"
    path = urdf(tmp_path, base + slider(link))
    imported = import_object(path, tmp_path / "out", grasp_frame="b")
    assert imported.joint == "j"
    plant = read(imported)
    X_Wb = plant.GetBodyByName("b").EvalPoseInWorld(plant.CreateDefaultContext())
    assert_allclose(X_Wb.rotation().matrix(), RotationMatrix.MakeYRotation(0.5).matrix())
    assert any("joint 'w' has limits without travel" in text for text in imported.warnings)


@pytest.mark.parametrize(
    ("body", "expected"),
    [
        (slider("<link name='b'/>", "<limit lower='0' upper='0'/>"), "joint with travel"),
        (slider("<link name='b'/>").replace("prismatic", "fixed"), "no prismatic or revolute"),
        (slider("<link name='c'/>"), "cannot be parsed"),
        (slider("<link name='b'><visual><geometry><mesh filename='http://x/m.stl'/></geometry>"
                "</visual></link>"), "http:// is not supported"),
        (slider("<link name='b'><visual><geometry><mesh filename='model.urdf'/></geometry>"
                "</visual></link>"), "cannot be read as a mesh"),
        (slider("<link name='b'/>") + "<link name='c'/><joint name='k' type='fixed'><parent "
         "link='c'/><child link='b'/></joint>", "child of two joints"),
    ],
)  # fmt: skip
def test_what_cannot_be_converted_is_refused_in_one_line(
    body: str, expected: str, tmp_path: Path
) -> None:
    message = refusal(urdf(tmp_path, body), tmp_path)
    assert expected in message
    assert "model.urdf" in message


def test_files_of_other_kinds_are_refused_in_one_line(tmp_path: Path) -> None:
    for text, expected in (
        ("<mujoco/>", "neither SDF"),
        ("<robot>", "not valid XML"),
        ("<robot xmlns:xacro='http://www.ros.org/wiki/xacro'><xacro:include filename='a'/></robot>",
         "expand it first"),
        ("<robot><link name='${prefix}a'/></robot>", "expand it first"),
    ):  # fmt: skip
        path = tmp_path / "model.xml"
        path.write_text(text)
        assert expected in refusal(path, tmp_path)
    assert "no such file" in refusal(tmp_path / "none.sdf", tmp_path)


def test_a_file_that_only_declares_xacros_namespace_is_no_xacro_file(tmp_path: Path) -> None:
    path = urdf(tmp_path, "<!-- made by xacro -->" + slider("<link name='b'/>"))
    declared = "<robot xmlns:xacro='http://www.ros.org/wiki/xacro' "
    path.write_text(path.read_text().replace("<robot ", declared))
    assert import_object(path, tmp_path / "out", grasp_frame="b").joint == "j"


@pytest.mark.parametrize(
    ("limits", "spring", "expected"),
    [((0.1, 0.5), 0.3, (0.0, 0.4)), ((-0.5, -0.1), 0.0, (-0.4, 0.0)), ((-0.1, 0.5), 0.0, None)],
)
def test_a_joint_whose_limits_leave_out_0_starts_at_the_nearest_one(
    limits: tuple, spring: float, expected: tuple | None, tmp_path: Path
) -> None:
    path = urdf(tmp_path, slider(f"<link name='b'><visual>{BOX}</visual></link>",
                                 f"<limit lower='{limits[0]}' upper='{limits[1]}'/>"))  # fmt: skip
    imported = import_object(path, tmp_path / "out", grasp_frame="b")
    plant = read(imported)
    joint = plant.GetJointByName("j")
    start = float(np.clip(0.0, *limits))
    given = (joint.position_lower_limits()[0], joint.position_upper_limits()[0])
    assert_allclose(given, expected or limits)
    pose = plant.GetBodyByName("b").EvalPoseInWorld(plant.CreateDefaultContext())
    assert_allclose(pose.translation(), [start, 0, 0], atol=1e-12)
    assert any(f"so it starts at {start:g}" in line for line in imported.warnings) is (start != 0)


def test_a_joint_that_follows_one_that_starts_elsewhere_keeps_its_relation(tmp_path: Path) -> None:
    follower = (
        "<link name='c'/><joint name='k' type='prismatic'><parent link='a'/><child link='c'/><axis"
        " xyz='0 1 0'/><limit lower='-2' upper='2'/><mimic joint='j' multiplier='3' offset='0.5'/>"
        "</joint>"
    )
    path = urdf(tmp_path, slider("<link name='b'/>", "<limit lower='0.2' upper='1'/>") + follower)
    text = import_object(path, tmp_path / "out", grasp_frame="b").model.read_text()
    offset = float(text.partition('multiplier="3.0" offset="')[2].partition('"')[0])
    assert_allclose(offset, 0.5 + 3 * 0.2)


@pytest.mark.parametrize("kind", ["ball", "universal"])
def test_a_joint_of_another_kind_below_the_hand_is_refused_by_its_kind(
    kind: str, tmp_path: Path
) -> None:
    axis = "" if kind == "ball" else "<axis><xyz>1 0 0</xyz></axis>"
    axis += "<axis2><xyz>0 1 0</xyz></axis2>" if kind == "universal" else ""
    path = tmp_path / "model.sdf"
    path.write_text(
        "<sdf version='1.9'><model name='m'><link name='a'/><link name='b'/><joint name='j'"
        f" type='{kind}'><parent>a</parent><child>b</child>{axis}</joint></model></sdf>"
    )
    assert f"joint 'j', which moves link 'b', is a {kind} joint" in refusal(path, tmp_path)


def test_a_screw_moves_in_the_copy_as_in_the_file(tmp_path: Path) -> None:
    path = tmp_path / "press.sdf"
    text = (SDF_DIR / "fly_press.sdf").read_text()
    path.write_text(text.replace("<drake:diffuse_map>textures/oak.png</drake:diffuse_map>", ""))
    imported = import_object(path, tmp_path / "out", grasp_frame="handle")
    assert not any("held fixed" in line for line in imported.warnings)
    ways = []
    for model in (path, imported.model):
        plant = MultibodyPlant(time_step=0.0)
        (instance,) = Parser(plant).AddModels(str(model))
        plant.WeldFrames(plant.world_frame(), plant.GetFrameByName("frame", instance))
        plant.Finalize()
        joint, context = plant.GetJointByName("spindle"), plant.CreateDefaultContext()
        head, poses = joint.child_body(), []
        for q in (0.0, 0.7):
            plant.SetPositions(context, np.array([q]))
            poses.append(head.EvalPoseInWorld(context))
        ways.append((poses[0].inverse() @ poses[1]).GetAsMatrix4())
        assert_allclose(joint.default_damping(), 0.3)
    assert_allclose(ways[1], ways[0], atol=1e-9)
    assert_allclose(ways[0][2, 3], -0.7 * 0.08 / (2.0 * np.pi), atol=1e-9)


def test_a_model_that_includes_itself_is_refused_in_one_line(tmp_path: Path) -> None:
    for name, other in (("one", "two"), ("two", "one")):
        (tmp_path / f"{name}.sdf").write_text(
            f"<sdf version='1.9'><model name='{name}'><link name='b'/><include><uri>{other}.sdf"
            "</uri></include></model></sdf>"
        )
    assert "two.sdf includes a file that includes it again" in refusal(
        tmp_path / "one.sdf", tmp_path
    )


@pytest.mark.parametrize("suffix", ["urdf", "sdf"])
def test_joints_in_a_closed_loop_are_refused_in_one_line(suffix: str, tmp_path: Path) -> None:
    path = tmp_path / f"model.{suffix}"
    links = "".join(f"<link name='{name}'/>" for name in "abcw")
    joints = [("j", "a", "b"), ("k", "b", "c"), ("l", "c", "a")]
    if suffix == "urdf":
        body = "".join(
            f"<joint name='{name}' type='continuous'><parent link='{parent}'/><child link='{child}'"
            "/><axis xyz='0 0 1'/></joint>"
            for name, parent, child in joints
        )
        path.write_text(f"<robot name='m'>{links}{body}</robot>")
    else:
        body = "".join(
            f"<joint name='{name}' type='revolute'><parent>{parent}</parent><child>{child}</child>"
            "<axis><xyz>0 0 1</xyz></axis></joint>"
            for name, parent, child in joints
        )
        path.write_text(f"<sdf version='1.9'><model name='m'>{links}{body}</model></sdf>")
    message = refusal(path, tmp_path)
    assert "form a closed loop; remove one of them" in message
    assert all(name in message for name in "jkl")


def test_included_models_are_written_into_the_copy(tmp_path: Path) -> None:
    (tmp_path / "shelf").mkdir()
    (tmp_path / "shelf" / "model.sdf").write_text(
        "<sdf version='1.9'><model name='shelf'><link name='b'><visual name='v'><geometry><mesh>"
        "<uri>b.stl</uri></mesh></geometry></visual></link></model></sdf>"
    )
    box([0.1, 0.1, 0.1], [0, 0, 0]).export(tmp_path / "shelf" / "b.stl")
    path = tmp_path / "rack.sdf"
    path.write_text(
        "<sdf version='1.9'><model name='rack'><link name='a'/><include><name>top</name><pose>0 0 1"
        " 0 0 0</pose><uri>model://shelf</uri></include><joint name='j' type='prismatic'><parent>a"
        "</parent><child>top::b</child><axis><xyz>1 0 0</xyz></axis></joint></model></sdf>"
    )
    plant = read(import_object(path, tmp_path / "out", grasp_frame="top::b"))
    pose = plant.GetBodyByName("b").EvalPoseInWorld(plant.CreateDefaultContext())
    assert_allclose(pose.translation(), [0, 0, 1])
