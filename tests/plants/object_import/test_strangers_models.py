"""Models made elsewhere, each with something that other programs take."""

import os
import re
import struct
from pathlib import Path

import numpy as np
import pytest
import trimesh
from numpy.testing import assert_allclose
from PIL import Image
from sideboard import BAR, FRONT, POSTS, SHELL, front_obj, joint, mesh, shapes, sideboard, written

from crossmodal.plants.object_import.inspection import Inspection, inspect_model
from crossmodal.plants.object_import.object_import import import_object

HANDLE = "tray@0.06,0,0,0,0,0"


def looked_into(folder: Path, text: str | bytes, scale: float = 1.0) -> Inspection:
    return inspect_model(written(folder, text), scale=scale)


def copied(
    folder: Path, text: str | bytes, frame: str = "tray", scale: float = 1.0
) -> tuple[str, list[str], Path]:
    """Text of a model's copy, the warnings, and its folder."""
    made = import_object(written(folder, text), folder / "out", grasp_frame=frame, scale=scale)
    return made.model.read_text(), made.warnings, made.model.parent


@pytest.mark.parametrize(
    "head",
    [
        '\n  <?xml version="1.0"?>\n',
        "<?xml version=1.0?>\n",
        '<!-- made by hand --><?xml version="1.0" encoding="UTF-8"?>',
        '<?xml version="1.0" encoding="us-ascii"?>',
        "",
    ],
)
def test_it_does_not_matter_how_the_xml_is_declared(head: str, tmp_path: Path) -> None:
    found = looked_into(tmp_path, sideboard(head=head))
    assert [handle.grasp_frame for handle in found.handles] == [HANDLE]


@pytest.mark.parametrize("encoding", ["latin-1", "utf-16", "utf-8-sig", "cp1252"])
@pytest.mark.parametrize("is_said", [True, False])
def test_text_of_other_encodings_is_read(encoding: str, is_said: bool, tmp_path: Path) -> None:
    head = f'<?xml version="1.0" encoding="{encoding}"?>' if is_said else ""
    text = sideboard(head=head).replace('"shell"', '"Körper"')
    found = looked_into(tmp_path, text.encode(encoding))
    assert found.links[0].name == "Körper"


@pytest.mark.parametrize("said", ["utf-16", "iso-8859-1", "undefined", "no-such-code", "ascii"])
def test_utf_8_is_read_whatever_it_says(said: str, tmp_path: Path) -> None:
    head = f'<?xml version="1.0" encoding="{said}"?>'
    text = sideboard(head=head).replace('"shell"', '"Körper"')
    assert looked_into(tmp_path, text.encode()).links[0].name == "Körper"


@pytest.mark.parametrize("name", ["side---board", "--", "a-->b", "-"])
def test_a_file_of_any_name_has_a_copy_that_is_read(name: str, tmp_path: Path) -> None:
    source = written(tmp_path, sideboard(), f"{name}.urdf")
    first = import_object(source, tmp_path / "out", grasp_frame="tray").model
    assert import_object(first, tmp_path / "again", grasp_frame="tray").model == first


def test_a_file_that_only_says_it_is_a_copy_is_checked_as_any_other(tmp_path: Path) -> None:
    first = import_object(written(tmp_path, sideboard()), tmp_path / "out", grasp_frame="tray")
    text = first.model.read_text()
    changed = re.sub(r"<plugin.*", "", text).replace("<ixx>", "<ixx>9")
    again = written(tmp_path / "forged", changed, "object.sdf")
    assert import_object(again, tmp_path / "again", grasp_frame="tray").model != again


@pytest.mark.parametrize("name", ["meshes/FRONT_0_visual_0.obj", "meshes/h.stl", "h.obj"])
def test_a_copy_whose_files_are_not_an_import_s_is_imported_again(
    name: str, tmp_path: Path
) -> None:
    written(tmp_path, front_obj(), "front.obj")
    text, _, folder = copied(tmp_path, sideboard(shapes(mesh("front.obj"))))
    box = trimesh.creation.box([0.02, 0.42, 0.18])
    if "FRONT" not in name:
        box.export(folder / name)
    changed = written(folder, text.replace("meshes/front_0_visual_0.obj", name), "mine.sdf")
    again = import_object(changed, tmp_path / "again", grasp_frame="tray")
    assert again.model != changed


@pytest.mark.parametrize(
    ("shape", "why"),
    [
        ('<box size="0 0.4 0.2"/>', "<box> without an extent left out: tray"),
        ('<box size="-1 0.4 0.2"/>', "<box> without an extent left out: tray"),
        ('<box size="nan 0.4 0.2"/>', "<box> without an extent left out: tray"),
        ('<cylinder radius="0" length="1"/>', "<cylinder> without an extent left out: tray"),
        ('<cylinder radius="0.1" length="inf"/>', "<cylinder> without an extent left out: tray"),
        ('<cylinder radius="0.1" length="1e300"/>', "<cylinder> without an extent left out: tray"),
        ('<sphere radius="0"/>', "<sphere> without an extent left out: tray"),
        ('<capsule radius="0.1" length="-1"/>', "<capsule> without an extent left out: tray"),
    ],
)
def test_shapes_without_an_extent_are_left_out(shape: str, why: str, tmp_path: Path) -> None:
    part = f"<collision><geometry>{shape}</geometry></collision>"
    found = looked_into(tmp_path, sideboard(shapes(FRONT) + part))
    assert why in found.warnings
    assert [handle.grasp_frame for handle in found.handles] == [HANDLE]


@pytest.mark.parametrize(
    "limit",
    [
        '<limit lower="0" upper="0.3" effort="inf" velocity="inf"/>',
        '<limit lower="0" upper="0.3" effort="-1" velocity="-0.5"/>',
        '<limit lower="0" upper="0.3" effort="nan" velocity="fast"/>',
        '<limit lower="0" upper="0.3"/>',
    ],
)
def test_what_a_motor_can_do_does_not_matter(limit: str, tmp_path: Path) -> None:
    (fact,) = looked_into(tmp_path, sideboard(limit=limit)).joints
    assert (fact.lower, fact.upper) == (0.0, 0.3)


@pytest.mark.parametrize("kind", ["fixed", "continuous"])
def test_limits_of_joints_that_have_none_do_not_matter(kind: str, tmp_path: Path) -> None:
    more = (
        f'<link name="knob">{shapes(BAR)}</link><joint name="turn" type="{kind}"><parent'
        ' link="shell"/><child link="knob"/><axis xyz="0 0 1"/><limit lower="3.14" upper="-3.14"/>'
        "</joint>"
    )
    assert looked_into(tmp_path, sideboard(more=more)).joints[1].name == "turn"


def test_limits_in_the_wrong_order_are_swapped(tmp_path: Path) -> None:
    found = looked_into(tmp_path, sideboard(limit='<limit lower="0.3" upper="0"/>'))
    assert (found.joints[0].lower, found.joints[0].upper) == (0.0, 0.3)
    assert "joint 'runner': lower limit above the upper, so swapped" in found.warnings
    sdf = """<sdf version="1.9"><model name="m"><link name="a"/><link name="b"/>
    <joint name="runner" type="prismatic"><parent>a</parent><child>b</child><axis><xyz>1 0 0</xyz>
    <limit><lower>0</lower><upper>-0.3</upper></limit></axis></joint></model></sdf>"""
    found = inspect_model(written(tmp_path, sdf, "m.sdf"))
    assert (found.joints[0].lower, found.joints[0].upper) == (-0.3, 0.0)


@pytest.mark.parametrize(
    ("limit", "message"),
    [
        ('<limit lower="nan" upper="1"/>', "joint 'runner': 'nan' must be a number"),
        ('<limit lower="0" upper="0.3"/><dynamics damping="-1"/>', "sideboard.urdf: cannot be"),
        ('<limit lower="0" upper="1"/><mimic joint="x" offset="nan"/>', "'nan' must be a number"),
    ],
)
def test_a_joint_that_cannot_be_is_refused_in_one_line(
    limit: str, message: str, tmp_path: Path
) -> None:
    with pytest.raises(ValueError, match=message) as refused:
        looked_into(tmp_path, sideboard(limit=limit))
    assert "sideboard.urdf" in str(refused.value)
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize(
    ("mimic", "other", "why"),
    [
        ("runner_b", "", "joint 'runner_b' mimics itself; it is free"),
        ("runner", '<mimic joint="runner_b"/>', "joint 'runner' mimics itself; it is free"),
        ("stay", "", "joint 'runner_b' mimics 'stay', which does not move; it is free"),
        ("nothing", "", "joint 'runner_b' mimics 'nothing', which there is not; it is free"),
    ],
)
def test_a_joint_that_follows_nothing_that_moves_is_free(
    mimic: str, other: str, why: str, tmp_path: Path
) -> None:
    limit = '<limit lower="0" upper="0.3"/>'
    follows = f'<mimic joint="{mimic}"/>'
    more = (
        f'<link name="tray_b">{shapes(FRONT)}</link><link name="plate">{shapes(FRONT)}</link>'
        f"{joint('runner_b', 'tray_b', limit + follows)}"
        '<joint name="stay" type="fixed"><parent link="shell"/><child link="plate"/></joint>'
    )
    text, warnings, _ = copied(tmp_path, sideboard(limit=limit + other, more=more))
    assert why in warnings
    assert text.count("mimic ") == (1 if other else 0)  # A loop is opened at one joint.


def test_all_that_is_a_length_is_scaled(tmp_path: Path) -> None:
    limit = '<limit lower="0" upper="300"/>'
    follows = '<mimic joint="runner" offset="50"/>'
    more = (
        f'<link name="tray_b">{shapes(FRONT)}</link><link name="wheel">{shapes(FRONT)}</link>'
        f"{joint('runner_b', 'tray_b', limit + follows)}"
        '<joint name="turn" type="revolute"><parent link="shell"/><child link="wheel"/>'
        '<axis xyz="0 0 1"/><limit lower="-1" upper="1"/>'
        '<mimic joint="runner" multiplier="0.01" offset="0.2"/></joint>'
    )
    text, _, _ = copied(tmp_path, sideboard(limit=limit, more=more), scale=0.001)
    followed = re.findall(r'mimic joint="runner" multiplier="([\d.]+)" offset="([\d.]+)"', text)
    assert_allclose(np.array(followed, float), [[1.0, 0.05], [10.0, 0.2]])
    sdf = """<sdf version="1.9"><model name="vice"><link name="base"/><link name="jaw"/>
    <joint name="thread" type="screw"><parent>base</parent><child>jaw</child>
    <screw_thread_pitch>50</screw_thread_pitch><axis><xyz>1 0 0</xyz></axis></joint>
    <link name="knob"/><joint name="spring" type="prismatic"><parent>base</parent>
    <child>knob</child><axis><xyz>1 0 0</xyz><dynamics><spring_reference>20</spring_reference>
    <spring_stiffness>3</spring_stiffness></dynamics></axis></joint></model></sdf>"""
    source = written(tmp_path, sdf, "vice.sdf")
    text = import_object(source, tmp_path / "v", grasp_frame="jaw", scale=0.001).model.read_text()
    assert "<screw_thread_pitch>0.05<" in text
    assert "<spring_reference>0.02<" in text


def test_a_mesh_that_is_missing_or_empty_is_left_out_unless_nothing_is_left(
    tmp_path: Path,
) -> None:
    written(tmp_path, "v 0 0 0\nv 1 0 0\n", "trim.obj")
    parts = shapes(FRONT) + shapes(mesh("knob-7.obj"), mesh("trim.obj"))
    found = looked_into(tmp_path, sideboard(parts))
    assert "mesh 'knob-7.obj', which there is not, left out: tray" in found.warnings
    assert "mesh trim.obj, which holds no triangles, left out: tray" in found.warnings
    assert [handle.grasp_frame for handle in found.handles] == [HANDLE]
    alone = sideboard().replace(shapes(SHELL), "")
    alone = alone.replace(shapes(FRONT) + shapes(BAR, *POSTS), shapes(mesh("knob-7.obj")))
    with pytest.raises(ValueError, match=r"'knob-7\.obj': there is no such file"):
        looked_into(tmp_path, alone)


def test_a_material_that_is_defined_nowhere_is_grey(tmp_path: Path) -> None:
    part = f'<visual>{FRONT}<material name="nowhere"/></visual><collision>{FRONT}</collision>'
    text, warnings, _ = copied(tmp_path, sideboard(part))
    assert "material 'nowhere' is defined nowhere, so it is grey" in warnings
    assert "<diffuse>0.6" in text


@pytest.mark.parametrize("first", ["knob-7.obj", "front.obj"])
def test_a_material_is_found_wherever_it_is_defined(first: str, tmp_path: Path) -> None:
    written(tmp_path, front_obj(), "front.obj")
    red = '<material name="red"><color rgba="1 0 0 1"/></material>'
    part = (
        f'<visual>{FRONT}<material name="red"/></visual><collision>{FRONT}</collision>'
        f"<visual>{mesh(first)}{red}</visual>"
    )
    text, warnings, _ = copied(tmp_path, sideboard(part))
    assert not any("grey" in line for line in warnings)
    assert "<diffuse>1.0 0.0 0.0 1.0</diffuse>" in text


@pytest.mark.parametrize("name", ["Parts/Front.OBJ", "parts/front.obj", "parts%2Ffront.obj"])
def test_a_file_is_found_in_other_case_and_percent_encoded(name: str, tmp_path: Path) -> None:
    tmp_path = tmp_path / "Door%20v2"
    written(tmp_path / "parts", front_obj(), "front.obj")
    found = looked_into(tmp_path, sideboard(shapes(mesh(name))))
    assert_allclose(found.links[1].size, [0.078, 0.42, 0.18], atol=1e-6)
    is_said = any("taken to be front.obj" in line for line in found.warnings)
    assert is_said == (name != "parts/front.obj")


@pytest.mark.parametrize(
    "line",
    [
        "map_Kd pictures/oak.png",
        "map_Kd pictures\\oak.png",
        'map_Kd "pictures/oak.png"',
        "map_Kd C:\\Users\\kim\\pictures\\oak.png",
        "map_Kd /home/kim/oak.png",
        "map_Kd Pictures/OAK.png",
        "map_Kd -s 1 1 1 -o 0 0 0 pictures/oak.png",
        "map_Kd -clamp on -bm 0.5 -mm 0 1 pictures/oak.png",
        "map_Kd -s 1 pictures/oak.png",
        "\tmap_kd\tpictures/oak.png",
    ],
)
def test_the_picture_of_a_mesh_is_found_however_it_is_named(line: str, tmp_path: Path) -> None:
    (tmp_path / "pictures").mkdir()
    for name in ("pictures/oak.png", "oak.png"):
        Image.new("RGB", (8, 8), (150, 100, 50)).save(tmp_path / name)
    written(tmp_path, front_obj("mtllib front.mtl"), "front.obj")
    written(tmp_path, f"newmtl skin\nKd 1 1 1\n{line}\n", "front.mtl")
    _, warnings, folder = copied(tmp_path, sideboard(shapes(mesh("front.obj"))))
    assert len(list(folder.rglob("*.png"))) == 1
    assert not any("png" in warning for warning in warnings)


def test_surfaces_with_the_same_picture_share_its_file(tmp_path: Path) -> None:
    Image.new("RGB", (8, 8), (150, 100, 50)).save(tmp_path / "oak.png")
    Image.new("RGB", (8, 8), (50, 100, 150)).save(tmp_path / "elm.png")
    for k, name in enumerate(("oak", "oak", "elm")):
        written(tmp_path, front_obj(f"mtllib {k}.mtl"), f"{k}.obj")
        written(tmp_path, f"newmtl skin\nKd 1 1 1\nmap_Kd {name}.png\n", f"{k}.mtl")
    parts = shapes(*(mesh(f"{k}.obj") for k in range(3)))
    _, _, folder = copied(tmp_path, sideboard(parts))
    assert len(list(folder.rglob("*.png"))) == 2
    assert len(list(folder.rglob("*.mtl"))) == 3


def test_a_picture_that_is_missing_or_placed_in_another_way_is_said(tmp_path: Path) -> None:
    Image.new("RGB", (8, 8)).save(tmp_path / "oak.png")
    written(tmp_path, front_obj("mtllib front.mtl"), "front.obj")
    written(tmp_path, "newmtl skin\nmap_Kd elm.png\n", "front.mtl")
    _, warnings, _ = copied(tmp_path, sideboard(shapes(mesh("front.obj"))))
    assert any(line.startswith("front.obj: 'elm.png': there is no such file") for line in warnings)
    written(tmp_path, "newmtl skin\nmap_Kd -s 2 2 1 oak.png\n", "front.mtl")
    _, warnings, _ = copied(tmp_path, sideboard(shapes(mesh("front.obj"))))
    assert "front.obj: 'map_Kd -s 2 2 1 oak.png': -s is left out" in warnings


@pytest.mark.parametrize(
    ("lines", "color", "alpha"),
    [
        ("Kd 0.4 0.6 0.9\nd 0.25", [0.4, 0.6, 0.9], 0.25),
        ("Kd 0.4 0.6 0.9\nTr 0.75", [0.4, 0.6, 0.9], 0.25),
        ("Kd 1 0 0\nd -halo 0.5", [1, 0, 0], 0.5),
        ("Kd 1 0 0", [1, 0, 0], 1.0),
        ("Kd 1 0 0\nd much", [1, 0, 0], 1.0),
        ("Kd 1 0 0\nTr 1", [1, 0, 0], 1.0),
        ("Kd 1 0 0\nd 0", [1, 0, 0], 1.0),
    ],
)
def test_glass_stays_glass(lines: str, color: list[float], alpha: float, tmp_path: Path) -> None:
    written(tmp_path, front_obj("mtllib front.mtl"), "front.obj")
    written(tmp_path, f"newmtl skin\n{lines}\n", "front.mtl")
    _, warnings, folder = copied(tmp_path, sideboard(shapes(mesh("front.obj"))))
    assert any("translucent" in line for line in warnings) == (alpha < 1.0)
    (library,) = folder.rglob("*.mtl")
    values = dict(line.split(" ", 1) for line in library.read_text().splitlines())
    assert float(values["d"]) == alpha
    assert_allclose(np.array(values["Kd"].split(), float), color, atol=0.003)


@pytest.mark.parametrize(
    "lines", ["mtllib a.mtl\nmtllib b c.mtl", "mtllib a.mtl b.mtl", "mtllib  a.mtl b.mtl \r"]
)
def test_all_libraries_of_a_mesh_are_read(lines: str, tmp_path: Path) -> None:
    written(tmp_path, front_obj(lines), "front.obj")
    written(tmp_path, "newmtl other\nKd 0 0 1\n", "a.mtl")
    written(tmp_path, "newmtl skin\nKd 1 0 0\n", "b c.mtl" if "b c" in lines else "b.mtl")
    _, _, folder = copied(tmp_path, sideboard(shapes(mesh("front.obj"))))
    (library,) = folder.rglob("*.mtl")
    assert "Kd 1 0 0" in library.read_text()


def test_a_mesh_in_latin_1_is_read(tmp_path: Path) -> None:
    written(tmp_path, f"# Tür\n{front_obj()}".encode("latin-1"), "front.obj")
    found = looked_into(tmp_path, sideboard(shapes(mesh("front.obj"))))
    assert_allclose(found.links[1].size, [0.078, 0.42, 0.18], atol=1e-6)


def test_meshes_that_cannot_be_read_are_refused_by_why(tmp_path: Path) -> None:
    front = trimesh.creation.box([0.02, 0.42, 0.18])
    header = b'{"asset": {"version": "2.0"}, "extensionsRequired": ["KHR_draco_mesh_compression"]}'
    header += b" " * (-len(header) % 4)
    chunk = struct.pack("<I4s", len(header), b"JSON") + header
    glb = b"glTF" + struct.pack("<II", 2, 12 + len(chunk)) + chunk
    stl = trimesh.exchange.stl.export_stl(front)
    for name, content, why in (
        ("front.glb", glb, "is compressed by KHR_draco_mesh_compression; export it without"),
        ("front.gltf", header, "is compressed by KHR_draco_mesh_compression; export it without"),
        ("front.stl", stl[:-60], "is cut off: 10 of 12 triangles are there"),
        ("front.stl", b"solid " + stl[6:-60], "is cut off: 10 of 12 triangles are there"),
        ("front.stl", stl[:50], "is cut off: 0 of its triangles are there"),
    ):
        written(tmp_path, content, name)
        with pytest.raises(ValueError, match=why):
            looked_into(tmp_path, sideboard(shapes(mesh(name))))
    written(tmp_path, b"solid Default\nendsolid Default\n", "front.stl")
    found = looked_into(tmp_path, sideboard(shapes(FRONT) + shapes(mesh("front.stl"))))
    assert any("holds no triangles, left out" in line for line in found.warnings)
    text = trimesh.exchange.stl.export_stl_ascii(front).upper()
    written(tmp_path, text, "front.stl")
    found = looked_into(tmp_path, sideboard(shapes(mesh("front.stl"))))
    assert_allclose(found.links[1].size, [0.078, 0.42, 0.18], atol=1e-6)
    written(tmp_path, b"solid " + stl[6:], "front.stl")
    found = looked_into(tmp_path, sideboard(shapes(mesh("front.stl"))))
    assert_allclose(found.links[1].size, [0.078, 0.42, 0.18], atol=1e-6)


@pytest.mark.parametrize(
    ("wall", "front", "attributes", "edge"),
    [
        (12.0, 1.0, "", 12.0),  # A wall in metres.
        (3000.0, 1000.0, "", 3.0),  # All of it in millimetres.
        (12.0, 1.0, ' scale="1 1 1"', 12.0),
        (3000.0, 1000.0, ' scale="0.001 0.001 0.001"', 3.0),
    ],
)
def test_meshes_are_in_the_unit_that_fits_the_rest(
    wall: float, front: float, attributes: str, edge: float, tmp_path: Path
) -> None:
    box = trimesh.creation.box([0.01 * wall, wall, 0.2 * wall])
    written(tmp_path, trimesh.exchange.obj.export_obj(box), "wall.obj")
    written(tmp_path, front_obj(scale=front), "front.obj")
    text = sideboard(
        shapes(mesh("front.obj", attributes)),
        shell=f"<visual>{mesh('wall.obj', attributes)}</visual>"
        f"<collision>{mesh('wall.obj', attributes)}</collision>",
    )
    found = looked_into(tmp_path, text)
    assert_allclose(found.links[0].size[1], edge, rtol=1e-6)
    assert_allclose(found.links[1].size, [0.078, 0.42, 0.18], atol=1e-6)


@pytest.mark.parametrize("place", ["0 0 0", "50 20 0"])
def test_where_a_model_stands_does_not_tell_its_unit(place: str, tmp_path: Path) -> None:
    box = trimesh.creation.box([400.0, 800.0, 200.0])
    written(tmp_path, trimesh.exchange.obj.export_obj(box), "box.obj")
    part = "<geometry><mesh><uri>box.obj</uri></mesh></geometry>"
    text = (
        f'<sdf version="1.9"><world name="w"><model name="m"><pose>{place} 0 0 0</pose>'
        f'<link name="l"><collision name="c">{part}</collision></link></model></world></sdf>'
    )
    assert_allclose(inspect_model(written(tmp_path, text, "m.sdf")).links[0].size[1], 0.8)


def test_frames_that_drake_makes_are_not_the_models(tmp_path: Path) -> None:
    text = sideboard().replace('<axis xyz="1 0 0"/>', '<axis xyz="1 0 0.1"/>')
    assert looked_into(tmp_path, text).frames == {}
    assert "<frame" not in copied(tmp_path, text)[0]


@pytest.mark.parametrize("order", [(0, 1, 2, 3), (3, 2, 1, 0), (2, 0, 3, 1)])
@pytest.mark.parametrize("turn", [0.0, 0.7])
def test_a_bar_is_found_whatever_is_written_first(
    order: tuple[int, ...], turn: float, tmp_path: Path
) -> None:
    parts = [FRONT, BAR, *POSTS]
    text = sideboard(shapes(*(parts[k] for k in order))).replace(shapes(BAR, *POSTS), "", 1)
    text = text.replace('<axis xyz="1 0 0"/>', f'<origin rpy="0 0 {turn}"/><axis xyz="1 0 0"/>')
    found = looked_into(tmp_path, text)
    assert [handle.grasp_frame for handle in found.handles] == [HANDLE]


def test_a_handle_faces_away_from_what_it_is_fixed_to_whatever_else_there_is(
    tmp_path: Path,
) -> None:
    """Two sideboards across an aisle, on a floor, beneath a lamp."""
    one = sideboard().replace("</robot>", "")
    other = re.sub(r'(name|link)="(\w+)"', r'\1="\2_b"', one.split("?>")[1])
    other = re.sub(r"<robot[^>]*>", "", other)
    room = '<origin xyz="0.5 0 {}"/><geometry><box size="4 4 0.02"/></geometry>'
    more = (
        f'<link name="room">{shapes(room.format(-0.4), room.format(2.0))}</link>'
        '<joint name="a" type="fixed"><parent link="room"/><child link="shell"/></joint>'
        '<joint name="b" type="fixed"><parent link="room"/><child link="shell_b"/>'
        '<origin xyz="1.2 0 0" rpy="0 0 3.1416"/></joint>'
    )
    found = looked_into(tmp_path, f"{one}{other}{more}</robot>")
    names = [HANDLE, HANDLE.replace("tray", "tray_b")]
    assert [handle.grasp_frame for handle in found.handles] == names


def test_a_bar_is_found_in_a_mesh_that_has_each_triangle_twice(tmp_path: Path) -> None:
    """And in one whose triangles share no vertices."""
    bar = trimesh.creation.box([0.016, 0.16, 0.016])
    bar.apply_translation([0.06, 0.0, 0.0])
    faces = np.concatenate([bar.faces, bar.faces[:, ::-1]])
    corners = np.arange(3 * len(faces)).reshape(-1, 3)
    for vertices, triangles in ((bar.vertices, faces), (bar.vertices[faces.ravel()], corners)):
        rows = [f"v {x} {y} {z}" for x, y, z in vertices]
        rows += [f"f {a} {b} {c}" for a, b, c in triangles + 1]
        written(tmp_path, "\n".join(rows), "bar.obj")
        text = sideboard().replace(shapes(BAR), shapes(mesh("bar.obj")))
        text = text.replace(BAR, mesh("bar.obj"))
        assert [handle.grasp_frame for handle in looked_into(tmp_path, text).handles] == [HANDLE]


def test_a_handle_that_is_a_link_of_its_own_faces_where_its_joint_lets_it_go(
    tmp_path: Path,
) -> None:
    """Beneath a worktop, which alone would turn it downwards."""
    grip = (
        f'<link name="grip">{shapes(BAR, *POSTS)}</link><joint name="screws" type="fixed">'
        '<parent link="tray"/><child link="grip"/></joint>'
    )
    top = '<origin xyz="0.1 0 0.12"/><geometry><box size="0.6 0.6 0.02"/></geometry>'
    text = sideboard(shell=shapes(top), more=grip).replace(shapes(FRONT) + shapes(BAR, *POSTS), "")
    text = text.replace('<link name="tray"></link>', f'<link name="tray">{shapes(FRONT)}</link>')
    (handle,) = looked_into(tmp_path, text).handles
    assert handle.grasp_frame == HANDLE.replace("tray", "grip")


@pytest.mark.parametrize(("axis", "count"), [("1 0 0", 1), ("0 1 0", 0)])
def test_a_bar_that_its_joint_draws_along_itself_is_no_handle(
    axis: str, count: int, tmp_path: Path
) -> None:
    text = sideboard().replace('<axis xyz="1 0 0"/>', f'<axis xyz="{axis}"/>')
    assert len(looked_into(tmp_path, text).handles) == count


def test_a_place_to_hold_is_the_bar_even_where_the_middle_of_the_part_is_not(
    tmp_path: Path,
) -> None:
    """A bow, of one mesh: bar and posts."""
    parts = [trimesh.creation.box([0.016, 0.16, 0.016])]
    parts += [trimesh.creation.box([0.06, 0.012, 0.016]) for _ in range(2)]
    for part, place in zip(parts, ([0.06, 0, 0], [0.03, 0.074, 0], [0.03, -0.074, 0]), strict=True):
        part.apply_translation(place)
    trimesh.boolean.union(parts).export(tmp_path / "bow.obj")
    text = sideboard().replace(shapes(BAR, *POSTS), shapes(mesh("bow.obj")))
    (handle,) = looked_into(tmp_path, text).handles
    at = np.array(handle.grasp_frame.partition("@")[2].split(","), float)
    assert_allclose(at, [0.06, 0, 0, 0, 0, 0], atol=0.02)


@pytest.mark.parametrize(
    ("part", "fault"),
    [
        (BAR.replace("0.06", "0.024"), "6 mm are free behind it, the fingers need 10 mm"),
        (BAR.replace("0.16", "0.04"), "it is 40 mm long and 16 mm thick, a knob needs 22 mm"),
    ],
)
def test_handles_that_the_hand_cannot_hold_are_named_and_why(
    part: str, fault: str, tmp_path: Path
) -> None:
    text = sideboard().replace(shapes(BAR, *POSTS), shapes(part))
    (handle,) = looked_into(tmp_path, text).handles
    assert handle.faults == [fault]


def test_what_is_deep_or_includes_itself_often_is_refused(tmp_path: Path) -> None:
    deep = "<a>" * 3000 + "</a>" * 3000
    with pytest.raises(ValueError, match="stand within each other"):
        looked_into(tmp_path, sideboard(more=deep))
    for k in range(31):
        twice = f"<include><uri>m{k + 1}.sdf</uri></include>" * 2
        inside = twice if k < 30 else '<link name="l"/>'
        written(tmp_path, f'<sdf version="1.9"><model name="m">{inside}</model></sdf>', f"m{k}.sdf")
    with pytest.raises(ValueError, match="includes more than"):
        inspect_model(tmp_path / "m0.sdf")


def test_what_is_no_file_is_refused_and_not_waited_for(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe.urdf")
    os.mkfifo(tmp_path / "pipe.obj")
    with pytest.raises(ValueError, match="is no file"):
        inspect_model(tmp_path / "pipe.urdf")
    found = looked_into(tmp_path, sideboard(shapes(FRONT) + shapes(mesh("pipe.obj"))))
    assert any("pipe.obj" in line for line in found.warnings)
    with pytest.raises(ValueError, match="there is no such file"):
        inspect_model(tmp_path / f"{'x' * 5000}.urdf")
