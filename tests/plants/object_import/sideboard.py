"""Writes a sideboard whose drawer has a bar, with something changed as in models of others."""

from pathlib import Path

import trimesh

BAR = '<origin xyz="0.06 0 0"/><geometry><box size="0.016 0.16 0.016"/></geometry>'
POSTS = [
    f'<origin xyz="0.03 {y} 0"/><geometry><box size="0.06 0.012 0.012"/></geometry>'
    for y in (-0.07, 0.07)
]
FRONT = '<geometry><box size="0.02 0.42 0.18"/></geometry>'
SHELL = '<origin xyz="-0.2 0 0"/><geometry><box size="0.36 0.44 0.2"/></geometry>'
LIMIT = '<limit lower="0" upper="0.3" effort="1" velocity="1"/>'
HEAD = '<?xml version="1.0"?>\n'


def shapes(*parts: str) -> str:
    """Each part, seen and touched."""
    return "".join(f"<visual>{p}</visual><collision>{p}</collision>" for p in parts)


def joint(name: str, child: str, inside: str = LIMIT, axis: str = "1 0 0") -> str:
    return (
        f'<joint name="{name}" type="prismatic"><parent link="shell"/><child link="{child}"/>'
        f'<axis xyz="{axis}"/>{inside}</joint>'
    )


def sideboard(
    tray: str = "", *, limit: str = LIMIT, more: str = "", shell: str = "", head: str = HEAD
) -> str:
    """The model.

    Args:
        tray: Shapes of the drawer beside its bar; its front by default.
        limit: Of its joint.
        more: Other links and joints.
        shell: What the shell has besides.
        head: What stands before.
    """
    return (
        f'{head}<robot name="sideboard"><link name="shell">{shapes(SHELL)}{shell}</link>'
        f'<link name="tray">{tray or shapes(FRONT)}{shapes(BAR, *POSTS)}</link>'
        f"{joint('runner', 'tray', limit)}{more}</robot>"
    )


def written(folder: Path, text: str | bytes, name: str = "sideboard.urdf") -> Path:
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / name
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return path


def front_obj(lines: str = "", scale: float = 1.0) -> str:
    """The drawer's front as OBJ with the material `skin`, after lines of its own."""
    mesh = trimesh.creation.box([0.02 * scale, 0.42 * scale, 0.18 * scale])
    rows = [f"v {x:.6g} {y:.6g} {z:.6g}" for x, y, z in mesh.vertices]
    rows += [f"vt {y % 1:.6g} {z % 1:.6g}" for _, y, z in mesh.vertices]
    rows += ["usemtl skin"]
    rows += [f"f {a}/{a} {b}/{b} {c}/{c}" for a, b, c in mesh.faces + 1]
    return lines + "\n" + "\n".join(rows) + "\n"


def mesh(name: str, attributes: str = "") -> str:
    return f'<geometry><mesh filename="{name}"{attributes}/></geometry>'
