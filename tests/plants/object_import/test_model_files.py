"""A model takes along images and meshes of its own, and nothing private of the user's."""

from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose
from PIL import Image
from wild_models import box

from crossmodal.plants.object_import.model_files import ModelFiles
from crossmodal.plants.object_import.object_import import ImportedObject, import_object

SECRET = b"-----BEGIN OPENSSH PRIVATE KEY-----"


@pytest.fixture
def home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A home folder with a private key, a private picture and a private mesh in it."""
    (tmp_path / "home" / "downloads").mkdir(parents=True)
    monkeypatch.setattr(Path, "home", lambda: tmp_path / "home")
    (tmp_path / "home" / "key.png").write_bytes(SECRET)
    picture(tmp_path / "home" / "me.png")
    box([0.1, 0.1, 0.1], [0, 0, 0]).export(tmp_path / "home" / "part.stl")
    return tmp_path / "home"


def picture(path: Path) -> Path:
    noise = np.random.default_rng(1).integers(0, 255, (8, 8, 3), dtype=np.uint8)
    path.parent.mkdir(parents=True, exist_ok=True)
    Image.fromarray(noise).save(path)
    return path


def sdf(path: Path, visual: str) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(
        "<sdf version='1.9'><model name='m'><link name='a'/><link name='b'><visual name='v'>"
        f"{visual}</visual></link><joint name='j' type='prismatic'><parent>a</parent><child>b"
        "</child><axis><xyz>1 0 0</xyz></axis></joint></model></sdf>"
    )
    return path


def with_texture(path: Path, uri: object) -> Path:
    return sdf(
        path,
        "<geometry><box><size>.1 .1 .1</size></box></geometry><material><diffuse>0.25 0.5 0.75 1"
        f"</diffuse><pbr><metal><albedo_map>{uri}</albedo_map></metal></pbr></material>",
    )


def with_mesh(path: Path, uri: object) -> Path:
    return sdf(path, f"<geometry><mesh><uri>{uri}</uri></mesh></geometry>")


def copied(source: Path, out: Path) -> tuple[ImportedObject, list[Path]]:
    imported = import_object(source, out, grasp_frame="b")
    return imported, [path for path in out.rglob("*.*") if path.name != "object.sdf"]


@pytest.mark.parametrize("uri", ["key.png", "folder"])
def test_a_texture_that_is_no_image_is_left_out_with_a_warning(uri: str, tmp_path: Path) -> None:
    (tmp_path / "m" / "folder").mkdir(parents=True)
    (tmp_path / "m" / "key.png").write_bytes(SECRET)
    imported, files = copied(with_texture(tmp_path / "m" / "m.sdf", uri), tmp_path / "out")
    assert f"<material> '{uri}': is not an image; left out" in imported.warnings
    assert files == []
    assert "0.25 0.5 0.75" in imported.model.read_text()


@pytest.mark.parametrize("uri", ["../me.png", "../../home/me.png", "{home}/me.png",
                                 "file://{home}/me.png", "model://home/me.png",
                                 "package://../home/me.png", "link.png"])  # fmt: skip
def test_an_image_from_elsewhere_is_left_out_with_a_warning(
    uri: str, home: Path, tmp_path: Path
) -> None:
    (home / "downloads" / "link.png").symlink_to(home / "me.png")
    uri = uri.format(home=home)
    imported, files = copied(with_texture(home / "downloads" / "m.sdf", uri), tmp_path / "out")
    assert any(f"'{uri}': lies outside the model's folder" in line for line in imported.warnings)
    assert files == []


def test_a_urdfs_texture_from_elsewhere_is_left_out_too(home: Path, tmp_path: Path) -> None:
    path = home / "downloads" / "m.urdf"
    path.write_text(
        "<robot name='m'><link name='a'/><link name='b'><visual><geometry><box size='.1 .1 .1'/>"
        "</geometry><material name='x'><texture filename='../me.png'/></material></visual></link>"
        "<joint name='j' type='continuous'><parent link='a'/><child link='b'/></joint></robot>"
    )
    imported, files = copied(path, tmp_path / "out")
    assert any("'../me.png': lies outside" in line for line in imported.warnings)
    assert files == []


@pytest.mark.parametrize("uri", ["../part.stl", "{home}/part.stl"])
def test_a_mesh_from_elsewhere_is_refused(uri: str, home: Path, tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="lies outside the model's folder and its package"):
        copied(with_mesh(home / "downloads" / "m.sdf", uri.format(home=home)), tmp_path / "out")


def test_an_include_from_elsewhere_is_refused(home: Path, tmp_path: Path) -> None:
    with_mesh(home / "other.sdf", "part.stl")
    path = home / "downloads" / "m.sdf"
    path.write_text(
        "<sdf version='1.9'><model name='m'><include><uri>../other.sdf</uri></include></model>"
        "</sdf>"
    )
    with pytest.raises(ValueError, match="lies outside the model's folder and its package"):
        copied(path, tmp_path / "out")


@pytest.mark.parametrize("uri", ["../me.png", "{home}/me.png", "link.png", "key.png"])
def test_a_mesh_takes_no_picture_from_elsewhere(uri: str, home: Path, tmp_path: Path) -> None:
    (home / "downloads" / "link.png").symlink_to(home / "me.png")
    (home / "downloads" / "key.png").write_bytes(SECRET)
    (home / "downloads" / "m.obj").write_text(
        "mtllib m.mtl\nusemtl s\nv 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 0 1\nf 1/1 2/2 3/3\n"
    )
    (home / "downloads" / "m.mtl").write_text(f"newmtl s\nmap_Kd {uri.format(home=home)}\n")
    _, files = copied(with_mesh(home / "downloads" / "m.sdf", "m.obj"), tmp_path / "out")
    assert [path.suffix for path in files if path.suffix not in (".obj", ".mtl")] == []


def test_the_models_own_pictures_are_copied_without_what_else_their_files_hold(
    tmp_path: Path,
) -> None:
    package = tmp_path / "deep" / "package"
    source = picture(package / "materials" / "textures" / "print.png")
    (package / "package.xml").write_text("<package/>")
    source.write_bytes(source.read_bytes() + SECRET)
    model = package / "robots" / "urdf" / "m.sdf"
    for uri in ("../../materials/textures/print.png", "package://package/materials/textures/print.png",
                source):  # fmt: skip
        imported, (file,) = copied(with_texture(model, uri), tmp_path / "out")
        assert_allclose(np.asarray(Image.open(file)), np.asarray(Image.open(source)))
        assert SECRET not in file.read_bytes()
        assert not any("left out" in line for line in imported.warnings)


def test_the_folder_around_the_models_own_is_the_models_without_a_package(tmp_path: Path) -> None:
    source = picture(tmp_path / "chest" / "textures" / "print.png")
    model = with_texture(tmp_path / "chest" / "sdf" / "m.sdf", "../textures/print.png")
    assert len(copied(model, tmp_path / "out")[1]) == 1
    files = ModelFiles(model, print)
    assert files.holds(source.resolve())
    assert not files.holds(picture(tmp_path / "other" / "print.png").resolve())


def test_a_mesh_in_a_folder_of_its_own_finds_its_pictures_beside_it(tmp_path: Path) -> None:
    picture(tmp_path / "m" / "textures" / "print.png")
    (tmp_path / "m" / "meshes").mkdir()
    (tmp_path / "m" / "meshes" / "m.obj").write_text(
        "mtllib m.mtl\nusemtl s\nv 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 0 1\nf 1/1 2/2 3/3\n"
    )
    (tmp_path / "m" / "meshes" / "m.mtl").write_text("newmtl s\nmap_Kd ../textures/print.png\n")
    _, files = copied(with_mesh(tmp_path / "m" / "m.sdf", "meshes/m.obj"), tmp_path / "out")
    assert [path.suffix for path in files].count(".png") == 1


@pytest.mark.parametrize("world", ["kitchen.sdf", "worlds/kitchen.sdf", "models/kitchen/model.sdf"])
def test_models_are_found_where_gazebo_has_them(world: str, tmp_path: Path) -> None:
    there = tmp_path / "g" / "models" / "cabinet"
    there.mkdir(parents=True)
    source = tmp_path / "g" / world
    files = ModelFiles(source, lambda line: None)
    assert files.find("model://cabinet", source.parent, "<uri>") == there.resolve()
    with pytest.raises(ValueError, match=r"'model://none': there is no such file; put its folder"):
        files.find("model://none", source.parent, "<uri>")
