"""Renders the images that the segmentation network learns from, scene by scene.

What the camera does to them is what it does in a station. The simulator's label image says what
each pixel shows.
"""

from collections.abc import Iterator
from dataclasses import dataclass, fields
from pathlib import Path

import numpy as np
import numpy.typing as npt
from pydrake.common.value import AbstractValue
from pydrake.geometry import (
    ClippingRange,
    ColorRenderCamera,
    DepthRange,
    DepthRenderCamera,
    QueryObject,
    RenderCameraCore,
)
from pydrake.math import RigidTransform, RotationMatrix

from crossmodal.diagrams.run.folder.written_files import write_atomically
from crossmodal.diagrams.run.process import ending_with_this_process
from crossmodal.maths.arrays import Array
from crossmodal.maths.pinhole import Intrinsics
from crossmodal.plants.camera_view import renderer_intrinsics
from crossmodal.plants.goods.dense_clutter import ClutterConfig, ClutterError, make_dense_clutter
from crossmodal.plants.goods.varied_scene import COLOUR, DEPTH, VariedScene
from crossmodal.systems.segmentation.network_input import CLASSES, OTHER, SHAPE
from crossmodal.systems.sensors.depth_noise import DepthNoiseConfig
from crossmodal.systems.sensors.randomness import make_generator
from crossmodal.systems.sensors.rgbd_camera import CameraNoise, CameraNoiseConfig

VIEWS, DENSE_VIEWS = 6, 18  # Of each scene, and of each that is dense.
HELD_OUT = 10  # Every so many scenes, one is not learned from.
GOODS = CLASSES[1:-1]
_DENSE = 4  # Every so many scenes, one is as dense as those that are worked in.
_TRIES = 5
_FIELD = np.deg2rad(58.0)  # Horizontally.
_AWAY = 0.35, 0.8  # From the camera to what it looks at, [m].
_ELEVATION = np.deg2rad(35.0), np.deg2rad(90.0)
_FRAME_RATE = 30.0  # The camera's noise is another one at each frame, [Hz].


@dataclass(frozen=True, kw_only=True)
class Images:
    """Of one scene or of several.

    Attributes:
        colour: Red, green and blue (N, H, W, 3).
        depth: (N, H, W), [m]; zero where none was measured.
        labels: Indices of `CLASSES` (N, H, W).
        camera: fx, fy, cx, cy (N, 4), [px].
        X_WC: Of the cameras (N, 4, 4); the table's plane is z = 0.
        scene: Its number (N,).
    """

    colour: npt.NDArray[np.uint8]
    depth: npt.NDArray[np.float16]
    labels: npt.NDArray[np.uint8]
    camera: Array
    X_WC: Array
    scene: npt.NDArray[np.int64]

    def __getitem__(self, chosen: npt.NDArray[np.bool_]) -> "Images":
        return Images(**{f.name: getattr(self, f.name)[chosen] for f in fields(self)})

    def intrinsics(self, index: int) -> Intrinsics:
        """Of one image."""
        focal_x, focal_y, center_x, center_y = map(float, self.camera[index])
        return Intrinsics(
            width=SHAPE[2],
            height=SHAPE[1],
            focal_x=focal_x,
            focal_y=focal_y,
            center_x=center_x,
            center_y=center_y,
        )


def is_held_out(scene: npt.NDArray[np.int64]) -> npt.NDArray[np.bool_]:
    """Which scenes are not learned from."""
    return np.asarray(scene % HELD_OUT == HELD_OUT - 1)


def is_dense(scene: npt.NDArray[np.int64]) -> npt.NDArray[np.bool_]:
    """Which scenes are dense clutter of goods around one of them."""
    return np.asarray(scene % _DENSE == 1)  # Every fifth of them is held out.


def make_scene(seed: int, scene: int) -> VariedScene:
    """A scene by the seed and its number: dense clutter, or goods and unknown shapes as dropped."""
    rng = make_generator(seed, "segmentation scene", scene)
    names = [str(name) for name in rng.permutation(GOODS)]
    if is_dense(np.array(scene)):
        clutter = ClutterConfig(count=int(rng.integers(3, 10)))
        try:
            poses = make_dense_clutter(
                clutter, names[0], names[1:], np.zeros(3), int(rng.integers(2**31))
            )
            return VariedScene([*poses], 0, rng, poses)
        except (ClutterError, ValueError):  # What does not lie on any side, say.
            pass
    for _ in range(_TRIES):
        some = names[: rng.integers(2, len(names) + 1)]
        twice = [name for name in some if rng.random() < 0.15]
        try:
            return VariedScene([*some, *twice], int(rng.integers(0, 5)), rng)
        except RuntimeError:  # Things may start in each other, and the solver not part them.
            continue
    raise ClutterError(f"seed {seed}: none of {_TRIES} scenes number {scene} could be simulated")


def render_scene(seed: int, scene: int, views: int = VIEWS) -> Images:
    """So many images of a scene, from anywhere."""
    made, rng = make_scene(seed, scene), make_generator(seed, "segmentation views", scene)
    numbers = np.zeros(2**16, np.uint8)  # Classes by Drake's labels; what has none is table.
    for label, name in made.classes.items():
        numbers[label] = CLASSES.index(name or OTHER)
    query, shots = made.query(), []
    for view in range(views):
        X_WC, intrinsics = _look(rng), _intrinsics(rng)
        shots.append(_shoot(query, made, X_WC, intrinsics, numbers, rng, view))
    colour, depth, labels, camera, X = (np.stack(values) for values in zip(*shots, strict=True))
    return Images(
        colour=colour,
        depth=depth,
        labels=labels,
        camera=camera,
        X_WC=X,
        scene=np.full(views, scene),
    )


def _look(rng: np.random.Generator) -> RigidTransform:
    """X_WC of a camera on a wrist that looks at the things."""
    elevation, azimuth = rng.uniform(*_ELEVATION), rng.uniform(-np.pi, np.pi)
    level = np.array([np.cos(azimuth), np.sin(azimuth), 0.0])
    z = -np.cos(elevation) * level - np.sin(elevation) * np.array([0.0, 0.0, 1.0])
    x = np.array([-np.sin(azimuth), np.cos(azimuth), 0.0])
    R_WC = RotationMatrix(np.column_stack([x, np.cross(z, x), z]))
    middle = [*rng.normal(scale=0.05, size=2), rng.uniform(0.0, 0.12)]
    roll = RotationMatrix.MakeZRotation(rng.normal(scale=0.3))
    return RigidTransform(R_WC @ roll, middle - rng.uniform(*_AWAY) * z)


def _intrinsics(rng: np.random.Generator) -> Intrinsics:
    _, height, width = SHAPE
    focal = 0.5 * width / np.tan(0.5 * _FIELD) * rng.uniform(0.95, 1.05)
    u, v = rng.normal(scale=2.0, size=2)
    return Intrinsics(
        width=width,
        height=height,
        focal_x=focal,
        focal_y=focal,
        center_x=0.5 * (width - 1) + u,
        center_y=0.5 * (height - 1) + v,
    )


def _shoot(
    query: QueryObject,
    scene: VariedScene,
    X_WC: RigidTransform,
    intrinsics: Intrinsics,
    numbers: npt.NDArray[np.uint8],
    rng: np.random.Generator,
    frame: int,
) -> tuple[Array, ...]:
    """Colour, depth, labels, camera and X_WC of one image, with the camera's faults."""
    info = renderer_intrinsics(intrinsics)
    near = ClippingRange(0.05, 10.0)
    colour, depth = (
        RenderCameraCore(name, info, near, RigidTransform()) for name in (COLOUR, DEPTH)
    )
    seen, world = DepthRange(0.1, 8.0), scene.world
    noise = CameraNoise(_faults(rng), info, int(rng.integers(2**31)), is_metered=False)
    context = noise.CreateDefaultContext()
    context.SetTime(frame / _FRAME_RATE)
    for port, image in (
        ("color_image", query.RenderColorImage(ColorRenderCamera(colour), world, X_WC)),
        ("depth_image", query.RenderDepthImage(DepthRenderCamera(depth, seen), world, X_WC)),
        ("surface_image", query.RenderDepthImage(DepthRenderCamera(colour, seen), world, X_WC)),
    ):
        noise.GetInputPort(port).FixValue(context, AbstractValue.Make(image))
    # White that is too bright once in a while, and dusk.
    noise.GetInputPort("illumination").FixValue(context, [np.exp(rng.normal(scale=0.35))])
    measured = noise.GetOutputPort("color_measured").Eval(context).data[:, :, :3]
    z = noise.GetOutputPort("depth_measured").Eval(context).data[:, :, 0]
    labels = query.RenderLabelImage(ColorRenderCamera(colour), world, X_WC).data[:, :, 0]
    return (
        measured.copy(),
        z.astype(np.float16),
        numbers[labels.astype(np.uint16)],
        intrinsics.vector(),
        X_WC.GetAsMatrix4(),
    )


def _faults(rng: np.random.Generator) -> CameraNoiseConfig:
    return CameraNoiseConfig(
        depth=DepthNoiseConfig(
            range_min=rng.uniform(0.2, 0.4),
            through_glass=rng.uniform(0.0, 0.6),
            glass_delay=rng.uniform(0.0, 4e-3),
            grazing_angle=rng.uniform(1.3, 1.5),
            correlation_window=int(rng.choice([3, 5, 7])),
        )
    )


def _scene_file(folder: Path, seed: int, scene: int) -> Path:
    return folder / f"segmentation-{seed}-{scene:05d}.npz"


def _write_scene(folder: Path, seed: int, scene: int) -> None:
    file = _scene_file(folder, seed, scene)
    if not file.exists():
        dense = bool(is_dense(np.array(scene)))
        made = render_scene(seed, scene, DENSE_VIEWS if dense else VIEWS)
        values = {f.name: getattr(made, f.name) for f in fields(made)}

        def save(path: Path) -> None:
            with path.open("wb") as stream:
                np.savez_compressed(stream, **values)

        write_atomically(file, save)


def write_scenes(folder: Path, seed: int, count: int, jobs: int = 1) -> Iterator[None]:
    """Renders scenes into files, those that are not there; yields after each."""
    from joblib import Parallel, delayed

    one = delayed(ending_with_this_process(_write_scene))
    work = (one(folder, seed, scene) for scene in range(count))
    yield from Parallel(n_jobs=jobs, return_as="generator_unordered")(work)


def read_scenes(folder: Path, seed: int, count: int) -> Images:
    """All images of so many scenes, which must be there."""
    made = [np.load(_scene_file(folder, seed, scene)) for scene in range(count)]
    return Images(**{f.name: np.concatenate([m[f.name] for m in made]) for f in fields(Images)})
