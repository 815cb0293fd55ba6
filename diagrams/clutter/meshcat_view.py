"""Draws what is measured, believed and planned of an object's pose into Meshcat."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import trimesh
from pydrake.geometry import (
    Mesh,
    Meshcat,
    Rgba,
    Role,
    SceneGraph,
    Sphere,
)
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.perception import BaseField, Fields, PointCloud
from pydrake.systems.framework import (
    Context,
    Diagram,
    DiagramBuilder,
    LeafSystem,
    System,
)

from crossmodal.diagrams.clutter.estimator_names import COLORS, LABELS
from crossmodal.diagrams.clutter.meshcat_graph import GRAPH_LEGEND, GraphLayer
from crossmodal.diagrams.clutter.meshcat_requests import GRID, MUCH, Touches, Views, as_mesh
from crossmodal.diagrams.clutter.robot_config import OBJECT
from crossmodal.diagrams.clutter.scenario import Scenario, target_mesh, target_name
from crossmodal.diagrams.drawing import palette
from crossmodal.diagrams.drawing.layers import Layers, Viewpoint
from crossmodal.diagrams.drawing.legend import Entry, show_legend
from crossmodal.diagrams.drawing.meshcat import (
    ROOT,
    TRUTH,
    Shown,
    clear_view,
    estimator_layers,
    legend_title,
    rigid_transform,
    scene_path,
    show_from,
    upright_pose,
)
from crossmodal.diagrams.drawing.text_board import text_board
from crossmodal.diagrams.run.record import TaskStatus
from crossmodal.diagrams.run.recorder import STATUS_PORT, declare_input, read_inputs
from crossmodal.diagrams.run.wiring import connect_latest
from crossmodal.maths.arrays import Array, Ids
from crossmodal.maths.gaussian import chi_square_gate
from crossmodal.systems.active.view_planner import NO_GRID
from crossmodal.systems.port_values import (
    NO_GRAPH,
    NO_MEASUREMENT,
    NO_TOUCH,
    NO_VIEW,
    UNKNOWN_POSE,
    ObjectPose,
    PoseMeasurement,
)

_TRUTH = "cheat_object_pose"
_PERIOD = 0.1  # Between drawings, [s].
_TEXT_INTERVAL = 0.5  # Least time between new texts, [s].
# From where the page is first seen, and what the texts face.
VIEWPOINT = Viewpoint(p_WV=np.array([0.66, -0.82, 0.8]), p_WT=np.array([0.5, 0.0, 0.2]))
_BOARD_HEIGHT = 0.028  # [m]
_ABOVE = 0.62  # Of the texts above the table, [m].
_CLOUD, _CONTACT, _MIDDLE = "#66CCEE", "#CC3311", "#332288"
_MOST_POINTS = 3000  # Of a view's cloud.
_GHOSTS = 6
_FADED = 0.3  # Opacity of the simulated object.
_RADII = float(np.sqrt(chi_square_gate(0.05, 3)))  # Of a 95 % ellipsoid, in standard deviations.


def _legend(shown: str, clears: bool) -> list[Entry]:
    return [
        *(GRAPH_LEGEND if clears else []),
        ("dot", _CLOUD, "point that a view has measured"),
        ("dot", _CONTACT, "contact that a touch has felt"),
        ("bar", palette.QUIET, "the simulated object"),
        ("bar", COLORS.get(shown, palette.QUIET), "the object as believed; faint: as it may be"),
        ("dot", _MIDDLE, "where its middle is with 95 %"),
        ("dot", GRID, "cell that is occupied with p > 0.6"),
        ("bar", MUCH, "candidate view or touch; the greyer, the less it would teach"),
        ("bar", palette.PLAN, "the chosen one; ball: where contact is expected"),
        ("bar", palette.TRUTH, "the object where it truly is, if that is shown"),
    ]


def add_view(
    builder: DiagramBuilder,
    scenario: Scenario,
    meshcat: Meshcat,
    station: Diagram,
    estimators: Mapping[str, System],
) -> Layers:
    """Adds a view of what is measured, believed and planned."""
    bodies = {}
    if station.HasSubsystemNamed("scene_graph"):  # A rig has no scene.
        bodies = _object_meshes(station.GetSubsystemByName("scene_graph"))
    view = builder.AddNamedSystem(
        "meshcat_view",
        MeshcatView(
            meshcat,
            list(estimators),
            target_name(scenario),
            _read(target_mesh(scenario), scenario.target.scale),
            bodies,
            clears=scenario.clutter.count > 0,
        ),
    )
    clearing = ["declutter_graph"] if scenario.clutter.count else []
    ports = ["pose_measurement", "view_latest", "touch_latest", "grid_latest", STATUS_PORT, _TRUTH]
    for port in [*ports, *clearing]:
        builder.Connect(station.GetOutputPort(port), view.GetInputPort(port))
    connect_latest(builder, estimators, view)
    return Layers(estimators=estimator_layers(estimators, LABELS), truth=TRUTH)


def _object_meshes(scene_graph: SceneGraph) -> dict[str, tuple[Array, Ids]]:
    """Vertices (V, 3), [m], and triangles (T, 3) of the simulated object's meshes, by path."""
    inspector = scene_graph.model_inspector()
    found = {}
    for geometry in inspector.GetAllGeometryIds(Role.kIllustration):
        shape = inspector.GetShape(geometry)
        frame = inspector.GetName(inspector.GetFrameId(geometry))
        if isinstance(shape, Mesh) and frame.startswith(f"{OBJECT}::"):
            found[scene_path(inspector, geometry)] = _read(shape.source().path(), shape.scale())
    return found


def _read(path: Path, scale: float) -> tuple[Array, Ids]:
    mesh = trimesh.load(str(path), force="mesh")
    return scale * np.asarray(mesh.vertices), np.asarray(mesh.faces)


class MeshcatView(LeafSystem):
    """Draws measurements, beliefs about the pose, and candidate views and touches into Meshcat.

    What is new is drawn once, below a path of its own, and takes the place of what it follows.
    Beliefs of all estimators are drawn below `/perception`, those of the first one visible; the
    others can be switched on in Meshcat's tree. Grid and candidate views vanish with the first
    touch that is wanted.

    What has been drawn is kept outside the Context, so one view serves one simulation.

    Input ports:
    - `pose_measurement`: `PoseMeasurement`, the last one.
    - `view_latest`: `ViewRequest`.
    - `touch_latest`: `TouchRequest`.
    - `grid_latest`: `OccupancyGrid`.
    - `task_status`: `TaskStatus`.
    - `cheat_object_pose`: `RigidTransform` X_WO, drawn for whom wants it.
    - `declutter_graph`: `DeclutterGraph`, if something is cleared away.
    - `<estimator>_object_pose_latest`: `ObjectPose`.

    Frames: W world, O the object's mesh, M its middle, C camera, A an approach (z along it).

    Args:
        estimators: Names; the first is shown at first.
        target: The object's name.
        mesh: Its vertices (V, 3) in O, [m], and triangles (T, 3).
        bodies: Meshes by path, which take the place of what the scene shows there, so that one can
            look into them.
        clears: Whether things are cleared away before.
    """

    def __init__(
        self,
        meshcat: Meshcat,
        estimators: Sequence[str],
        target: str,
        mesh: tuple[Array, Ids],
        bodies: Mapping[str, tuple[Array, Ids]] | None = None,
        clears: bool = False,
    ) -> None:
        super().__init__()
        self._meshcat = meshcat
        clear_view(meshcat, VIEWPOINT)
        models = {
            "pose_measurement": NO_MEASUREMENT,
            "view_latest": NO_VIEW,
            "touch_latest": NO_TOUCH,
            "grid_latest": NO_GRID,
            STATUS_PORT: TaskStatus(),
            _TRUTH: RigidTransform(),
            **({"declutter_graph": NO_GRAPH} if clears else {}),
        }
        self._ports = {name: declare_input(self, name, model) for name, model in models.items()}
        self._beliefs = {
            name: declare_input(self, f"{name}_object_pose_latest", UNKNOWN_POSE)
            for name in estimators
        }
        self._layers = {
            name: _Belief(meshcat, f"{ROOT}/{name}", COLORS.get(name, palette.QUIET), mesh)
            for name in estimators
        }
        meshcat.SetTriangleMesh(
            f"{TRUTH}/object", *as_mesh(*mesh), Rgba(*palette.rgb(palette.TRUTH))
        )
        shown = next(iter(estimators), "")
        for name in estimators:
            meshcat.SetProperty(f"{ROOT}/{name}", "visible", name == shown)
        show_legend(meshcat, legend_title(shown, LABELS), _legend(shown, clears))
        self._measured = _Measured(meshcat, f"{ROOT}/measured")
        self._views = Views(meshcat, f"{ROOT}/views")
        self._touches = Touches(meshcat, f"{ROOT}/touches")
        self._graph = GraphLayer(meshcat, f"{ROOT}/graph")
        self._texts = _Texts(meshcat, f"{ROOT}/text", target)
        self._bodies = dict(bodies or {})
        self.DeclarePeriodicPublishEvent(_PERIOD, 0.0, self._draw)

    def _draw(self, context: Context) -> None:
        time = context.get_time()
        if time > 0.0:  # At first the scene itself is drawn, which may be later than this.
            while self._bodies:
                path, (vertices, faces) = self._bodies.popitem()
                color = Rgba(*palette.rgb(palette.QUIET), _FADED)
                self._meshcat.SetTriangleMesh(path, *as_mesh(vertices, faces), color)
        values = read_inputs(self._ports, context)
        beliefs = read_inputs(self._beliefs, context)
        measurement = values.get("pose_measurement", NO_MEASUREMENT)
        view, touch = values.get("view_latest", NO_VIEW), values.get("touch_latest", NO_TOUCH)
        self._measured.draw(time, measurement)
        over = touch.number > 0 or touch.done
        self._views.draw(time, view, values.get("grid_latest", NO_GRID), over)
        self._touches.draw(time, touch)
        for name, belief in beliefs.items():
            self._layers[name].draw(time, belief)
        first = next(iter(beliefs.values()), UNKNOWN_POSE)
        self._graph.draw(time, values.get("declutter_graph", NO_GRAPH), over=first.known)
        if _TRUTH in values:
            self._meshcat.SetTransform(f"{TRUTH}/object", values[_TRUTH], time)
        status = values.get(STATUS_PORT, TaskStatus())
        self._texts.draw(time, status, self._measured, first)


class _Measured:
    """What views and touches have measured, each in its own cloud.

    Attributes:
        views: Their number.
        touches: Their number.
    """

    def __init__(self, meshcat: Meshcat, path: str) -> None:
        self._meshcat, self._path, self._number = meshcat, path, 0
        self.views = self.touches = 0

    def draw(self, time: float, new: PoseMeasurement) -> None:
        if new.number <= self._number:
            return
        self._number = new.number
        self.views += new.kind == "view"
        self.touches += new.kind == "touch"
        if len(new.points) == 0:
            return
        path = f"{self._path}/{new.kind}_{new.number}"
        if new.kind == "view":
            step = -(-len(new.points) // _MOST_POINTS)
            cloud = PointCloud(len(new.points[::step]), Fields(BaseField.kXYZs))
            cloud.mutable_xyzs()[:] = new.points[::step].T
            self._meshcat.SetObject(path, cloud, 0.0025, Rgba(*palette.rgb(_CLOUD)))
        else:
            for n, point in enumerate(new.points):
                ball = f"{path}/{n}"
                self._meshcat.SetObject(ball, Sphere(0.006), Rgba(*palette.rgb(_CONTACT)))
                self._meshcat.SetTransform(ball, RigidTransform(point))
        show_from(self._meshcat, path, time)


_PARTS = ("pose", "samples", "middle")


class _Belief:
    """The object at the pose that an estimator reports and at some of its samples."""

    def __init__(self, meshcat: Meshcat, path: str, color: str, mesh: tuple[Array, Ids]) -> None:
        self._meshcat, self._path, self._number = meshcat, path, -1
        self._known = False
        parts = {"pose": 0.45, **{f"samples/{n}": 0.1 for n in range(_GHOSTS)}}
        vertices, faces = as_mesh(*mesh)
        for part, opacity in parts.items():
            shade = Rgba(*palette.rgb(color), opacity)
            meshcat.SetTriangleMesh(f"{path}/{part}", vertices, faces, shade)
        meshcat.SetObject(f"{path}/middle/ball", Sphere(1.0), Rgba(*palette.rgb(_MIDDLE), 0.7))
        for part in _PARTS:
            meshcat.SetProperty(f"{path}/{part}", "visible", False)

    def draw(self, time: float, belief: ObjectPose) -> None:
        if not belief.known or belief.number == self._number:
            return
        path, set_transform = self._path, self._meshcat.SetTransform
        set_transform(f"{path}/pose", rigid_transform(belief.X_WO), time)
        some = np.linspace(0, len(belief.samples) - 1, _GHOSTS).astype(int)
        for n, X_WM in enumerate(belief.samples[some]):
            X_WO = X_WM.copy()
            X_WO[:3, 3] -= X_WM[:3, :3] @ belief.middle
            set_transform(f"{path}/samples/{n}", rigid_transform(X_WO), time)
        variances, axes = np.linalg.eigh(belief.covariance[3:, 3:])
        axes[:, 2] = np.cross(axes[:, 0], axes[:, 1])
        R = RotationMatrix.ProjectToRotationMatrix(axes)
        set_transform(f"{path}/middle", RigidTransform(R, belief.X[:3, 3]), time)
        radii = _RADII * np.sqrt(np.maximum(variances, 1e-8))
        self._meshcat.SetProperty(f"{path}/middle/ball", "scale", radii.tolist(), time)
        if not self._known:
            for part in _PARTS:
                show_from(self._meshcat, f"{path}/{part}", time)
        self._known, self._number = True, belief.number


class _Texts:
    """Two lines above the object: what is done, and how well its pose is known."""

    def __init__(self, meshcat: Meshcat, path: str, target: str) -> None:
        self._meshcat, self._path, self._target = meshcat, path, target
        self._text = ["", ""]
        self._boards = [Shown(meshcat), Shown(meshcat)]
        self._drawn, self._number = -np.inf, 0

    def draw(
        self, time: float, status: TaskStatus, measured: _Measured, belief: ObjectPose
    ) -> None:
        texts = [
            f"{self._target}: {'done' if status.done else status.phase or 'waits'}",
            describe_belief(measured.views, measured.touches, belief),
        ]
        if texts == self._text or time < self._drawn + _TEXT_INTERVAL - 1e-6:
            return
        self._drawn = time
        for line, (text, board) in enumerate(zip(texts, self._boards, strict=True)):
            if text == self._text[line]:
                continue
            self._number += 1
            path = f"{self._path}/{self._number}"
            self._meshcat.SetObject(path, text_board(text, _BOARD_HEIGHT, (60, 60, 60)))
            p_W = np.append(VIEWPOINT.p_WT[:2], _ABOVE - 1.15 * _BOARD_HEIGHT * line)
            self._meshcat.SetTransform(path, upright_pose(p_W, VIEWPOINT.p_WV), time)
            board.show(path, time)
        self._text = texts


def describe_belief(views: int, touches: int, belief: ObjectPose) -> str:
    """How much was measured, and the standard deviations that are reported, along their largest
    axes."""
    made = f"{views} view{'s' * (views != 1)}, {touches} touch{'es' * (touches != 1)}"
    if not belief.known:
        return made
    turn, move = (
        float(np.sqrt(np.linalg.eigvalsh(C)[-1]))
        for C in (belief.covariance[:3, :3], belief.covariance[3:, 3:])
    )
    return f"{made}: σ up to {1e3 * move:.1f} mm, {np.rad2deg(turn):.1f}°"
