"""Writes models such as they are found in the wild: meshes of all kinds, masses left out."""

from pathlib import Path

import numpy as np
import trimesh
from PIL import Image
from trimesh.transformations import rotation_matrix

BAR = dict(radius=0.009, height=0.17)


def box(size: list[float], at: list[float]) -> trimesh.Trimesh:
    mesh = trimesh.creation.box(size)
    mesh.apply_translation(at)
    return mesh


def bar(at: list[float], axis: list[float]) -> trimesh.Trimesh:
    """A bar handle with its two posts, 7 cm in front of x = 0."""
    along = trimesh.geometry.align_vectors([0, 0, 1], axis)
    parts = [trimesh.creation.cylinder(**BAR, sections=16)]
    parts[0].apply_transform(along)
    for side in (-1, 1):
        post = trimesh.creation.cylinder(radius=0.007, height=0.07, sections=12)
        post.apply_transform(rotation_matrix(np.pi / 2, [0, 1, 0]))
        post.apply_translation(np.array([-0.035, 0, 0]) + side * 0.078 * np.array(axis))
        parts.append(post)
    mesh = trimesh.util.concatenate(parts)
    mesh.apply_translation(at)
    return mesh


def textured(mesh: trimesh.Trimesh, seed: int) -> trimesh.Trimesh:
    """The mesh with a blotchy print, mapped along its two largest axes, 20 cm a tile."""
    small = np.random.default_rng(seed).integers(40, 230, (24, 24, 3), dtype=np.uint8)
    image = Image.fromarray(small).resize((256, 256), Image.Resampling.BICUBIC)
    mesh = mesh.copy()
    mesh.unmerge_vertices()
    first, second = np.argsort(mesh.extents)[::-1][:2]
    uv = mesh.vertices[:, [first, second]] / 0.2
    material = trimesh.visual.material.PBRMaterial(baseColorTexture=image, metallicFactor=0.0)
    mesh.visual = trimesh.visual.TextureVisuals(uv=uv, material=material)
    return mesh


def write_door(folder: Path) -> Path:
    """SDF world: a cupboard with an STL door in millimetres, beside a ground plane.

    The door gives no inertia and no collision geometry, the hinge no limits; the handle's frame is
    in a nested model.
    """
    folder.mkdir(parents=True, exist_ok=True)
    leaf = trimesh.util.concatenate([box([0.018, 0.36, 0.4], [0.009, 0.18, 0]),
                                     bar([0.088, 0.31, 0.0], [0, 0, 1])])  # fmt: skip
    leaf.apply_scale(1000.0)
    leaf.export(folder / "leaf.stl")
    path = folder / "door.world"
    path.write_text("""<?xml version="1.0"?>
<sdf version="1.9">
  <world name="kitchen">
    <model name="ground"><static>true</static><link name="plane"><collision name="c"><geometry>
      <plane><normal>0 0 1</normal></plane></geometry></collision></link></model>
    <model name="cupboard">
      <pose>2 3 0.4 0 0 1</pose>
      <link name="case">
        <inertial><mass>8</mass><inertia><ixx>1</ixx><iyy>0.1</iyy><izz>0.1</izz></inertia>
        </inertial>
        <visual name="back"><pose>-0.3 0.18 0 0 0 0</pose><geometry><box><size>0.02 0.4 0.44</size>
          </box></geometry><material><diffuse>0.6 0.5 0.3 1</diffuse></material></visual>
        <visual name="side"><pose>-0.155 0.39 0 0 0 0</pose><geometry><box><size>0.31 0.02 0.44
          </size></box></geometry><material><diffuse>0.6 0.5 0.3 1</diffuse></material></visual>
        <collision name="side"><pose>-0.155 0.39 0 0 0 0</pose><geometry><box><size>0.31 0.02 0.44
          </size></box></geometry><surface><friction><ode><mu>0.3</mu></ode></friction></surface>
        </collision>
      </link>
      <model name="door">
        <link name="leaf">
          <visual name="mesh"><geometry><mesh><uri>leaf.stl</uri></mesh></geometry>
            <material><diffuse>0.85 0.8 0.7 1</diffuse></material></visual>
        </link>
        <frame name="grip" attached_to="leaf"><pose>0.088 0.31 0 1.5707963267948966 0 0</pose>
        </frame>
      </model>
      <joint name="hinge" type="revolute"><parent>case</parent><child>door::leaf</child>
        <axis><xyz>0 0 -1</xyz></axis></joint>
    </model>
  </world>
</sdf>
""")
    return path


def write_cabinet(folder: Path) -> Path:
    """URDF in a package: a body (COLLADA in centimetres), two drawers (GLB), one above the other.

    No link gives an inertia that a body can have; the lower drawer has a tray that slides in it.
    """
    package = folder / "wild_cabinet"
    (package / "urdf").mkdir(parents=True, exist_ok=True)
    (package / "meshes").mkdir(exist_ok=True)
    (package / "package.xml").write_text("<package><name>wild_cabinet</name></package>")
    case = trimesh.util.concatenate([box([0.4, 0.02, 0.5], [-0.21, side * 0.22, 0])
                                     for side in (-1, 1)])  # fmt: skip
    write_dae(case, package / "meshes" / "case.dae")
    drawer = trimesh.Scene()
    front = textured(box([0.018, 0.41, 0.2], [0.009, 0, 0]), 3)
    handle = bar([0.088, 0, 0], [0, 1, 0])
    handle.visual.face_colors = [140, 140, 150, 255]
    y_up = rotation_matrix(-np.pi / 2, [1, 0, 0])
    for name, mesh in (("front", front), ("handle", handle)):
        drawer.add_geometry(mesh, geom_name=name, node_name=name, transform=y_up)
    drawer.export(package / "meshes" / "drawer.glb")

    def link(name: str, z: float) -> str:
        mesh = "package://wild_cabinet/meshes/drawer.glb"
        return f"""
  <link name="{name}"><inertial><mass value="2"/><inertia ixx="0" iyy="0" izz="0" ixy="0" ixz="0"
    iyz="0"/></inertial><visual><geometry><mesh filename="{mesh}"/></geometry></visual></link>
  <joint name="{name}" type="prismatic"><origin xyz="0 0 {z}"/><parent link="case"/>
    <child link="{name}"/><axis xyz="1 0 0"/><limit lower="0" upper="0.35" effort="5"
    velocity="1"/></joint>
  <link name="{name}_grip"/>
  <joint name="{name}_grip_fixed" type="fixed"><origin xyz="0.088 0 0"/><parent link="{name}"/>
    <child link="{name}_grip"/></joint>"""

    path = package / "urdf" / "cabinet.urdf"
    path.write_text(f"""<?xml version="1.0"?>
<robot name="cabinet">
  <link name="world"/>
  <joint name="standing" type="fixed"><parent link="world"/><child link="case"/></joint>
  <link name="case"><visual><geometry>
    <mesh filename="package://wild_cabinet/meshes/case.dae"/></geometry></visual></link>
  {link("upper", 0.12)}{link("lower", -0.12)}
  <link name="tray"><visual><geometry><box size="0.1 0.1 0.02"/></geometry></visual></link>
  <joint name="tray_slide" type="prismatic"><origin xyz="-0.1 0 0"/><parent link="lower"/>
    <child link="tray"/><axis xyz="0 1 0"/><limit lower="-0.1" upper="0.1" effort="1" velocity="1"/>
  </joint>
</robot>
""")
    return path


def write_chest(folder: Path) -> Path:
    """URDF: a chest that floats, with a lid that opens to negative angles, a mimicking latch."""
    folder.mkdir(parents=True, exist_ok=True)
    lid = trimesh.util.concatenate([box([0.3, 0.36, 0.012], [0.15, 0, 0.006]),
                                    box([0.012, 0.36, 0.05], [0.306, 0, -0.01]),
                                    bar([0.382, 0, 0.0], [0, 1, 0])])  # fmt: skip
    lid.export(folder / "lid.obj")
    path = folder / "chest.urdf"
    path.write_text("""<?xml version="1.0"?>
<robot name="chest">
  <material name="blue"><color rgba="0.2 0.3 0.7 1"/></material>
  <link name="trunk"><visual><origin xyz="0.15 0 -0.15"/><geometry><box size="0.3 0.36 0.3"/>
    </geometry><material name="blue"/></visual></link>
  <link name="lid"><visual><geometry><mesh filename="lid.obj"/></geometry><material name="blue"/>
    </visual></link>
  <joint name="lid_hinge" type="revolute"><parent link="trunk"/><child link="lid"/>
    <axis xyz="0 1 0"/><limit lower="-1.5" upper="0" effort="1" velocity="1"/></joint>
  <link name="grip"/>
  <joint name="grip_fixed" type="fixed"><origin xyz="0.382 0 0"/><parent link="lid"/>
    <child link="grip"/></joint>
  <link name="latch"><visual><geometry><box size="0.02 0.02 0.02"/></geometry></visual></link>
  <joint name="latch_turn" type="continuous"><origin xyz="0.3 0.1 -0.1"/><parent link="trunk"/>
    <child link="latch"/><axis xyz="1 0 0"/><mimic joint="lid_hinge" multiplier="0.5"/></joint>
</robot>
""")
    return path


def write_dae(mesh: trimesh.Trimesh, path: Path) -> None:
    """COLLADA in centimetres; the exporter writes metres and knows no units."""
    mesh = mesh.copy()
    mesh.apply_scale(100.0)
    brown = trimesh.visual.material.SimpleMaterial(diffuse=[150, 110, 70, 255])
    mesh.visual = trimesh.visual.TextureVisuals(material=brown)
    text = trimesh.exchange.dae.export_collada(mesh).decode()
    assert "<asset>" in text
    path.write_text(text.replace("<asset>", '<asset><unit name="centimeter" meter="0.01"/>'))
