"""Draws what the network believes into Meshcat, live and in the recording."""

from collections.abc import Mapping, Sequence

import numpy as np
from pydrake.common.value import Value
from pydrake.geometry import Cylinder, Mesh, Meshcat, MeshcatCone, Rgba
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.systems.framework import (
    Context,
    Diagram,
    DiagramBuilder,
    InputPort,
    LeafSystem,
    System,
)

from crossmodal.diagrams.crossmodal.modalities import LABELS
from crossmodal.diagrams.crossmodal.results.report import describe_configuration, describe_pitch
from crossmodal.diagrams.crossmodal.scenario import Scenario
from crossmodal.diagrams.drawing import palette
from crossmodal.diagrams.drawing.dots import set_dots
from crossmodal.diagrams.drawing.layers import Layers, Viewpoint
from crossmodal.diagrams.drawing.legend import Entry, show_legend
from crossmodal.diagrams.drawing.meshcat import (
    ROOT,
    TRUTH,
    Shown,
    clear_view,
    estimator_layers,
    frame_along,
    legend_title,
    rigid_transform,
    show_from,
    upright_pose,
)
from crossmodal.diagrams.drawing.text_board import text_board
from crossmodal.diagrams.drawing.textures import textured_boxes
from crossmodal.diagrams.joints.joint_drawing import (
    BAR_HEIGHT,
    BAR_LENGTH,
    JointSketch,
    helix_along,
    sketch_joint,
)
from crossmodal.diagrams.joints.joint_metrics import joint_in_world
from crossmodal.diagrams.joints.joint_palette import JOINT, body_color, body_label
from crossmodal.diagrams.joints.joint_truth import (
    TRUTH_QUANTITIES,
    Truth,
    add_tick,
    truth_of_ticks,
)
from crossmodal.diagrams.run.record import Tick
from crossmodal.diagrams.run.recorder import declare_input, read_inputs
from crossmodal.diagrams.run.wiring import connect_latest
from crossmodal.maths import se3
from crossmodal.maths.arrays import Array
from crossmodal.maths.vectors import normal_basis
from crossmodal.systems.port_values import (
    HELD_BODY,
    STATIC_BODY,
    BodyMotion,
    BodyMotions,
    FeatureBelief,
    JointBelief,
    JointBeliefs,
    JointType,
    no_features,
)

_PERIOD = 0.1  # Between drawings, [s].
_REFRESH_INTERVAL = 1.0  # Between new sets of features, which move between them, [s].
_TEXT_INTERVAL = 0.5  # Least time between new texts, [s].
# From where the page is first seen, and what the texts face.
VIEWPOINT = Viewpoint(p_WV=np.array([-0.25, 0.75, 1.45]), p_WT=np.array([0.6, -0.2, 0.85]))
_DOT_RADIUS = 0.009  # Of a feature, [m].
_BAR_RADIUS = 0.007  # [m]
_BOARD_HEIGHT = 0.05  # [m]
_LEGEND: list[Entry] = [
    *(("dot", body_color(body), body_label(body)) for body in (STATIC_BODY, HELD_BODY, 2, 3)),
    ("bar", JOINT[JointType.PRISMATIC], "prismatic joint, its direction within 2σ"),
    ("bar", JOINT[JointType.REVOLUTE], "revolute joint, its axis within 2σ"),
    ("bar", JOINT[JointType.SCREW], "screw, its axis within 2σ"),
    ("line", palette.PLAN, "planned way of the hand"),
    ("bar", palette.TRUTH, "the true joint, if it is shown"),
]


def add_view(
    builder: DiagramBuilder,
    scenario: Scenario,
    meshcat: Meshcat,
    station: Diagram,
    estimators: Mapping[str, System],
) -> Layers:
    """Adds a view of what the estimators believe, and lets the scene be seen with its textures."""
    scene_graph = station.GetSubsystemByName("scene_graph")
    view = builder.AddNamedSystem(
        "meshcat_view",
        MeshcatView(meshcat, list(estimators), textured_boxes(scene_graph)),
    )
    for port in ("path_planned", *(quantity.port for quantity in TRUTH_QUANTITIES)):
        builder.Connect(station.GetOutputPort(port), view.GetInputPort(port))
    connect_latest(builder, estimators, view)
    return Layers(estimators=estimator_layers(estimators, LABELS), truth=TRUTH)


class MeshcatView(LeafSystem):
    """Draws each modality's features, coloured by body, and joint into Meshcat.

    A recording holds transforms and properties, no new geometry. So features are drawn as clouds
    that are fixed in their body and move with it; every `refresh_interval` new clouds take the
    place of the old ones, which are hidden. Joints are unit shapes that are scaled. All modalities
    are drawn below `/perception`, one visible; the others can be switched on in Meshcat's tree.

    What has been drawn is kept outside the Context, so one view serves one simulation.

    Args:
        textured: Meshes by path, which take the place of what the scene shows there.

    Input ports:
    - `<modality>_joints_latest`, `<modality>_body_motions_latest`, `<modality>_features_latest`:
      `JointBeliefs`, `BodyMotions` and `FeatureBelief`; what has no source stays unconnected.
    - `path_planned`: poses (N, 4, 4) in W of the end-effector's planned way; N = 0 without a plan.
    - `cheat_joint`: `JointTruth`; where its parent moves, the joint between two moving bodies is
      drawn, not the one to the environment.
    - `cheat_configuration`, `cheat_body_pose`, `interaction_active`: `TRUTH_QUANTITIES`, by which
      configurations count from the grasp.

    Frames: W world, B a moving body, J joint (z along the axis), V the viewer.
    """

    def __init__(
        self,
        meshcat: Meshcat,
        modalities: Sequence[str],
        textured: Mapping[str, Mesh] | None = None,
    ) -> None:
        super().__init__()
        self._meshcat, self._textured = meshcat, dict(textured or {})
        clear_view(meshcat, VIEWPOINT)
        self._ports: dict[str, dict[str, InputPort]] = {}
        self._layers: dict[str, _Layer] = {}
        models = {
            "joints": JointBeliefs(),
            "body_motions": BodyMotions(),
            "features": no_features(),
        }
        shown = "crossmodal" if "crossmodal" in modalities else next(iter(modalities), "")
        for modality in modalities:
            self._ports[modality] = {
                name: declare_input(self, f"{modality}_{name}_latest", model)
                for name, model in models.items()
            }
            self._layers[modality] = _Layer(meshcat, f"{ROOT}/{modality}")
            meshcat.SetProperty(f"{ROOT}/{modality}", "visible", modality == shown)
        show_legend(meshcat, legend_title(shown, LABELS), _LEGEND)
        self._path = self.DeclareAbstractInputPort("path_planned", Value[object]())
        self._truth_ports = {q.port: declare_input(self, q.port, q.model) for q in TRUTH_QUANTITIES}
        self._station: list[Tick] = []  # Those that the truth at the newest one follows from.
        self._truth = _TrueJoint(meshcat)
        self._plan = _PlannedPath(meshcat, f"{ROOT}/planned_path")
        self.DeclarePeriodicPublishEvent(_PERIOD, 0.0, self._draw)

    def _draw(self, context: Context) -> None:
        time = context.get_time()
        if time > 0.0:  # At first the scene itself is drawn, which may be later than this.
            while self._textured:
                self._meshcat.SetObject(*self._textured.popitem())
        add_tick(self._station, Tick(time=time, values=read_inputs(self._truth_ports, context)))
        truth = truth_of_ticks(self._station)
        self._truth.draw(time, truth)
        for modality, ports in self._ports.items():
            values = read_inputs(ports, context)
            bodies: BodyMotions = values.get("body_motions", BodyMotions())
            layer = self._layers[modality]
            layer.draw_features(time, values.get("features", no_features()), bodies.bodies)
            joints = values.get("joints", JointBeliefs())
            joint = joint_in_world(joints, bodies, truth.parent_moves)
            layer.draw_joint(time, joint, bodies.bodies, truth)
        if self._path.HasValue(context):
            self._plan.draw(time, self._path.Eval(context))


class _TrueJoint:
    """The explored joint as it is, at its body: its axis does not move in that."""

    def __init__(self, meshcat: Meshcat) -> None:
        self._meshcat = meshcat
        self._X_WB_0: Array | None = None

    def draw(self, time: float, truth: Truth) -> None:
        if truth.joint_type is None or len(truth.X_WB) == 0:
            return
        if self._X_WB_0 is None:
            self._X_WB_0 = truth.X_WB[0]
            self._make(truth)
        X_W = truth.X_WB[-1] @ se3.inverse(self._X_WB_0)
        self._meshcat.SetTransform(f"{TRUTH}/joint", rigid_transform(X_W), time)

    def _make(self, truth: Truth) -> None:
        color = Rgba(*palette.rgb(palette.TRUTH))
        p = truth.point_W
        if truth.joint_type == JointType.PRISMATIC:  # Its axis has no place.
            p = truth.X_WB[0, :3, 3] + np.array([0.0, 0.0, BAR_HEIGHT])
        axis = f"{TRUTH}/joint/axis"
        self._meshcat.SetObject(f"{axis}/bar", Cylinder(0.7 * _BAR_RADIUS, 1.3 * BAR_LENGTH), color)
        self._meshcat.SetObject(f"{axis}/tip/cone", MeshcatCone(0.045, 0.015, 0.015), color)
        tip = RigidTransform([0.0, 0.0, 0.65 * BAR_LENGTH]) @ _tip_pose()
        self._meshcat.SetTransform(f"{axis}/tip", tip)
        self._meshcat.SetTransform(axis, RigidTransform(frame_along(truth.axis_W), p))


class _PlannedPath:
    """The way that the end-effector has before it; a new line at every refresh."""

    def __init__(self, meshcat: Meshcat, path: str) -> None:
        self._meshcat, self._path = meshcat, path
        self._line, self._lines, self._drawn = Shown(meshcat), 0, -np.inf

    def draw(self, time: float, X_WE: Array) -> None:
        """Replaces the line when it is time; hides it without a plan."""
        if len(X_WE) == 0:
            self._line.hide(time)
        elif time >= self._drawn + _REFRESH_INTERVAL - 1e-6:
            self._lines += 1
            self._drawn = time
            path, color = f"{self._path}/line_{self._lines}", Rgba(*palette.rgb(palette.PLAN))
            self._meshcat.SetLine(path, X_WE[:, :3, 3].T, 4.0, color)
            self._line.show(path, time)


class _Layer:
    """The objects of one modality below one path."""

    def __init__(self, meshcat: Meshcat, path: str) -> None:
        self._meshcat = meshcat
        self._path = path
        self._clouds: dict[int, str] = {}  # Path of the visible cloud of each body.
        self._clouds_drawn = -np.inf
        self._sets = 0
        self._text = ""
        self._board = Shown(meshcat)
        self._text_drawn = -np.inf
        self._made: set[JointType] = set()
        self._joint = Shown(meshcat)

    def draw_features(self, time: float, features: FeatureBelief, bodies: list[BodyMotion]) -> None:
        """Moves the clouds with their bodies; draws new ones when it is time."""
        if time >= self._clouds_drawn + _REFRESH_INTERVAL - 1e-6:
            self._replace_clouds(time, features, bodies)
            self._clouds_drawn = time
        for body in bodies:
            if body.body_id in self._clouds:
                X_WB = rigid_transform(body.motion.X)
                self._meshcat.SetTransform(self._clouds[body.body_id], X_WB, time)

    def _replace_clouds(
        self, time: float, features: FeatureBelief, bodies: list[BodyMotion]
    ) -> None:
        for path in self._clouds.values():
            self._meshcat.SetProperty(path, "visible", False, time)
        self._clouds = {}
        self._sets += 1
        rest = np.ones(len(features.ids), dtype=bool)
        for body in bodies:
            mine = np.isin(features.ids, body.assigned_ids)
            rest &= ~mine
            R, p = body.motion.X[:3, :3], body.motion.X[:3, 3]
            self._add_cloud(time, body.body_id, (features.p_WF[mine] - p) @ R)
        self._add_cloud(time, 0, features.p_WF[rest])

    def _add_cloud(self, time: float, body_id: int, points: Array) -> None:
        points = points[np.all(np.isfinite(points), axis=1)]
        if len(points) == 0:
            return
        path = f"{self._path}/features/set_{self._sets}/body_{body_id}"
        color = Rgba(*palette.rgb(body_color(body_id)))
        set_dots(self._meshcat, path, points, _DOT_RADIUS, color)
        show_from(self._meshcat, path, time)
        self._clouds[body_id] = path

    def draw_joint(
        self, time: float, joint: JointBelief | None, bodies: list[BodyMotion], truth: Truth
    ) -> None:
        """Moves and scales the likeliest joint's shapes; hides the others."""
        sketch = None
        if joint is not None:
            body = next((b for b in bodies if b.body_id == joint.child_id), None)
            sketch = sketch_joint(joint, body)
        path = "" if sketch is None else self._joint_path(sketch.type)
        if path != self._joint.path:
            self._joint.hide(time)
            self._hide_text(time)
        if sketch is None or joint is None:
            return
        if path != self._joint.path:
            if sketch.type not in self._made:
                self._make_joint(sketch.type)
            self._joint.show(path, time)
        self._place_joint(time, sketch)
        configuration = describe_configuration(joint, truth, time)
        self._write_text(time, f"{sketch.type} {configuration}{describe_pitch(joint)}", sketch)

    def _joint_path(self, kind: JointType) -> str:
        return f"{self._path}/joint/{kind}"

    def _make_joint(self, kind: JointType) -> None:
        path = self._joint_path(kind)
        solid = Rgba(*palette.rgb(JOINT[kind]))
        clear = Rgba(solid.r(), solid.g(), solid.b(), 0.3)
        self._meshcat.SetObject(f"{path}/bar", Cylinder(_BAR_RADIUS, 1.0), solid)
        for side, turn in (("ahead", 0.0), ("behind", np.pi)):
            cone = f"{path}/direction_{side}"
            self._meshcat.SetObject(f"{cone}/cone", MeshcatCone(1.0, 1.0, 1.0), clear)
            self._meshcat.SetTransform(cone, RigidTransform(RotationMatrix.MakeXRotation(turn)))
        if kind == JointType.SCREW:
            thread = helix_along(np.array([0.0, 0.0, BAR_LENGTH]))
            self._meshcat.SetLine(f"{path}/helix", thread.T, 3.0, solid)
        if kind != JointType.PRISMATIC:
            self._meshcat.SetObject(f"{path}/position", Cylinder(1.0, 1.0), clear)
        else:
            self._meshcat.SetObject(f"{path}/tip/cone", MeshcatCone(0.045, 0.02, 0.02), solid)
            self._meshcat.SetTransform(f"{path}/tip/cone", _tip_pose())
        self._made.add(kind)

    def _place_joint(self, time: float, sketch: JointSketch) -> None:
        path = self._joint_path(sketch.type)
        x, y = normal_basis(sketch.direction_W)
        R_WJ = RotationMatrix(np.column_stack([x, y, sketch.direction_W]))
        self._meshcat.SetTransform(path, RigidTransform(R_WJ, sketch.center_W), time)
        half = 0.5 * sketch.length
        spread = max(half * float(np.tan(sketch.angle)), 1e-4)
        self._meshcat.SetProperty(f"{path}/bar", "scale", [1.0, 1.0, sketch.length], time)
        for side in ("ahead", "behind"):
            cone = f"{path}/direction_{side}/cone"
            self._meshcat.SetProperty(cone, "scale", [spread, spread, half], time)
        if sketch.type != JointType.PRISMATIC:
            radius = max(sketch.radius, 1e-4)
            self._meshcat.SetProperty(
                f"{path}/position", "scale", [radius, radius, sketch.length], time
            )
        else:
            tip = RigidTransform([0.0, 0.0, half])
            self._meshcat.SetTransform(f"{path}/tip", tip, time)

    def _write_text(self, time: float, text: str, sketch: JointSketch) -> None:
        due = time >= self._text_drawn + _TEXT_INTERVAL - 1e-6
        if text != self._text and due:
            self._hide_text(time)
            self._text, self._text_drawn = text, time
            path = f"{self._path}/text/{round(1000 * time)}"
            red, green, blue = (round(255 * c) for c in palette.rgb(JOINT[sketch.type]))
            board = text_board(text, _BOARD_HEIGHT, (red, green, blue))
            self._meshcat.SetObject(path, board)
            self._board.show(path, time)
        if self._board.path:
            self._meshcat.SetTransform(self._board.path, self._text_pose(sketch.center_W), time)

    def _hide_text(self, time: float) -> None:
        self._board.hide(time)
        self._text = ""

    def _text_pose(self, p_WJ: Array) -> RigidTransform:
        """Upright above a joint at p_WJ and in front of it, its -y towards the viewer."""
        to_viewer = VIEWPOINT.p_WV - p_WJ
        to_viewer /= np.linalg.norm(to_viewer)
        return upright_pose(p_WJ + np.array([0.0, 0.0, 0.1]) + 0.15 * to_viewer, VIEWPOINT.p_WV)


def _tip_pose() -> RigidTransform:
    """Meshcat's cone stands on its tip; this one points ahead, its base at the origin."""
    return RigidTransform(RotationMatrix.MakeXRotation(np.pi), [0.0, 0.0, 0.045])
