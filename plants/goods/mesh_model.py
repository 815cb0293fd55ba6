"""A rigid body that robots can see and touch, made from a mesh alone."""

from pathlib import Path

import numpy as np

from crossmodal.maths.arrays import Array, Ids

_CONCAVITY = 0.03  # By which convex parts may differ from the mesh, as a share of its size.
_MODULUS, _FRICTION = 1e7, 0.5


def write_mesh_model(vertices: Array, triangles: Ids, name: str, mass: float, folder: Path) -> Path:
    """Writes an SDF file and the meshes that it names into a folder; returns the file.

    What touches the body meets convex parts, into which the mesh is divided. It has one density.

    Args:
        vertices: (V, 3), [m].
        triangles: Of a closed surface (T, 3).
        name: Of the model and its link.
        mass: [kg].
        folder: That is there.
    """
    import coacd  # Slow, and needed for meshes of one's own alone.
    import trimesh

    mesh = trimesh.Trimesh(vertices, triangles, process=True)
    coacd.set_log_level("error")
    parts = coacd.run_coacd(coacd.Mesh(mesh.vertices, mesh.faces), threshold=_CONCAVITY, seed=0)
    hulls = [trimesh.Trimesh(*part).convex_hull for part in parts]
    files = {"body": mesh} | {f"part_{k}": hull for k, hull in enumerate(hulls)}
    for stem, one in files.items():
        text = one.export(file_type="obj", include_normals=stem == "body", include_color=False)
        (folder / f"{stem}.obj").write_text(text, encoding="utf-8")
    mesh.density = mass / mesh.volume
    moment, c = np.asarray(mesh.moment_inertia), mesh.center_mass
    inertia = "".join(
        f"<i{'xyz'[i]}{'xyz'[j]}>{moment[i, j]:.6e}</i{'xyz'[i]}{'xyz'[j]}>"
        for i in range(3)
        for j in range(i, 3)
    )
    contact = (
        "<drake:proximity_properties><drake:compliant_hydroelastic/>"
        f"<drake:hydroelastic_modulus>{_MODULUS:g}</drake:hydroelastic_modulus>"
        f"<drake:mu_static>{_FRICTION}</drake:mu_static>"
        f"<drake:mu_dynamic>{_FRICTION}</drake:mu_dynamic></drake:proximity_properties>"
    )
    collisions = "\n".join(
        f'      <collision name="part_{k}"><geometry><mesh><uri>part_{k}.obj</uri>'
        f"<drake:declare_convex/></mesh></geometry>{contact}</collision>"
        for k in range(len(hulls))
    )
    file = folder / "body.sdf"
    file.write_text(
        f"""<?xml version="1.0"?>
<sdf version="1.9" xmlns:drake="drake.mit.edu">
  <model name="{name}">
    <link name="{name}">
      <inertial>
        <pose>{c[0]:.6f} {c[1]:.6f} {c[2]:.6f} 0 0 0</pose>
        <mass>{mass:g}</mass><inertia>{inertia}</inertia>
      </inertial>
      <visual name="body">
        <geometry><mesh><uri>body.obj</uri></mesh></geometry>
        <material><diffuse>0.6 0.6 0.62 1</diffuse></material>
      </visual>
{collisions}
    </link>
  </model>
</sdf>
""",
        encoding="utf-8",
    )
    return file
