"""A picture of an object where it would stand before the arm, and of what the arm reaches."""

import numpy as np
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure
from matplotlib.patches import Circle
from pydrake.geometry import (
    ClippingRange,
    ColorRenderCamera,
    DepthRange,
    DepthRenderCamera,
    LightParameter,
    MakeRenderEngineVtk,
    RenderCameraCore,
    RenderEngineVtkParams,
)
from pydrake.math import RigidTransform
from pydrake.multibody.plant import MultibodyPlant
from pydrake.systems.framework import Context, Diagram, DiagramBuilder
from pydrake.systems.sensors import CameraInfo, RgbdSensor

from crossmodal.controllers.arm.inverse_kinematics import inverse_kinematics
from crossmodal.diagrams.crossmodal.robot_config import ARM, HAND
from crossmodal.diagrams.crossmodal.scenario import Scenario
from crossmodal.diagrams.crossmodal.station.station import draw_placements
from crossmodal.diagrams.drawing import palette
from crossmodal.diagrams.drawing.plot_style import STYLE, new_figure
from crossmodal.maths import se3
from crossmodal.maths.arrays import Array
from crossmodal.plants.object_import.solids import solid_of
from crossmodal.plants.robots.arm_with_hand import make_arm_with_load
from crossmodal.plants.robots.wam import WAM_WITH_SOFT_HAND
from crossmodal.plants.scene import ManipulationScene, add_manipulation_scene, facing

_WIDTH, _HEIGHT = 720, 600  # Of the rendered picture, [pixels].
_ARROW = 0.25  # Length of the one that shows the pull, [m].
_SAMPLES = 4000  # Postures by which the arm's reach is found.
_OBJECT, _ARM, _TABLE = "#4477AA", "#B8B8B8", "#E3D9C6"


def picture(scenario: Scenario, title: str) -> Figure:
    """The scene as rendered, and from above and the side with the arm's reach.

    Args:
        scenario: Resolved; its object stands where no seed moves it.
        title: Above the picture.
    """
    builder = DiagramBuilder()
    name = scenario.task.object or next(iter(scenario.objects))
    placements = draw_placements(scenario)
    placements[name].X_WO = scenario.object.pose()
    scene = add_manipulation_scene(builder, scenario.plant, placements, [(ARM, HAND)])
    sensor = _add_camera(builder, scene)
    diagram = builder.Build()
    root = diagram.CreateDefaultContext()
    context = scene.plant.GetMyMutableContextFromRoot(root)
    frame = scene.plant.GetFrameByName(scenario.object.handle_frame, scene.objects[name])
    X_WHandle = frame.CalcPoseInWorld(context)
    X_WBase = scene.pose("base", ARM)
    arm = make_arm_with_load(WAM_WITH_SOFT_HAND, X_WBase)
    is_reached = True
    try:
        before = facing(X_WHandle) @ RigidTransform(
            [0.0, 0.0, -scenario.control.sequence.approach_distance]
        )
        q = inverse_kinematics(arm, before, scenario.control.posture)
    except ValueError:
        q, is_reached = scenario.control.posture, False
    scene.plant.SetPositions(context, scene.model(ARM), q)
    with rc_context(STYLE):
        figure = new_figure(12.0, 4.3)
        left, above, side = figure.subplots(1, 3, width_ratios=[1.45, 1.0, 1.0])
    figure.suptitle(title, x=0.008, ha="left", fontsize=12)
    caption = "arrow: the pull at the handle     dashed: the arm's reach, from its shoulder"
    figure.supxlabel(caption, x=0.99, ha="right", fontsize=9, color="#444444")
    left.imshow(_rendered(sensor, diagram, root))
    left.set_axis_off()
    reach, center = _reach(arm)
    pull = X_WHandle.rotation() @ scenario.object.pull_direction
    for axes, second, words in ((above, 1, "from above"), (side, 2, "from the side")):
        _draw_solids(axes, scene, context, name, second)
        middle = (center[0], center[second])
        axes.add_patch(Circle(middle, reach, fill=False, ls="--", color=palette.QUIET, zorder=4))
        _draw_handle(axes, X_WHandle.translation(), pull, second, is_reached)
        axes.set(title=words, xlabel="x [m]", ylabel=f"{'xyz'[second]} [m]", aspect="equal")
        axes.set_xlim(-0.35, max(1.5, float(X_WHandle.translation()[0]) + 0.4))
    above.set_ylim(-1.1, 1.1)
    side.set_ylim(-0.1, 1.9)
    for axes in (above, side):
        axes.grid(color="#EEEEEE", zorder=0)
    return figure


def _reach(arm: MultibodyPlant) -> tuple[float, Array]:
    """Largest distance of the end-effector from the shoulder, [m], and where that is (3,)."""
    context = arm.CreateDefaultContext()
    lower, upper = arm.GetPositionLowerLimits(), arm.GetPositionUpperLimits()
    E = arm.GetFrameByName("end_effector")
    shoulder = arm.GetJointByName("joint_2").frame_on_parent()
    center = shoulder.CalcPoseInWorld(context).translation()
    farthest = 0.0
    for q in np.random.default_rng(0).uniform(lower, upper, (_SAMPLES, len(lower))):
        arm.SetPositions(context, q)
        p_WE = E.CalcPoseInWorld(context).translation()
        farthest = max(farthest, float(np.linalg.norm(p_WE - center)))
    return farthest, center


def _draw_solids(
    axes: Axes, scene: ManipulationScene, context: Context, name: str, second: int
) -> None:
    plant, inspector = scene.plant, scene.scene_graph.model_inspector()
    models = [(scene.objects[name], _OBJECT, 3)]
    models += [(scene.model(model), _ARM, 2) for model in (ARM, HAND)]
    if plant.HasModelInstanceNamed("table"):
        models.append((scene.model("table"), _TABLE, 1))
    for model, color, order in models:
        bodies = [plant.get_body(index) for index in plant.GetBodyIndices(model)]
        solid = solid_of(plant, inspector, context, bodies, plant.world_frame(), visual=True)
        if solid.is_empty:
            continue
        triangles = solid.vertices[solid.faces][:, :, [0, second]]
        axes.add_collection(PolyCollection(triangles, fc=color, ec="none", zorder=order))


def _draw_handle(axes: Axes, p_WHandle: Array, pull: Array, second: int, is_reached: bool) -> None:
    color = palette.OTHERS[2] if is_reached else palette.OTHERS[1]
    at = (p_WHandle[0], p_WHandle[second])
    length = _ARROW / np.linalg.norm(pull)
    to = (at[0] + length * pull[0], at[1] + length * pull[second])
    axes.annotate("", to, at, arrowprops={"arrowstyle": "-|>", "color": color, "lw": 2}, zorder=5)
    axes.plot(*at, "o", ms=6, color=color, zorder=6)
    if not is_reached:
        axes.annotate("out of reach", at, (0, 8), textcoords="offset points", ha="center",
                      fontsize=9, color=color, zorder=7)  # fmt: skip


def _add_camera(builder: DiagramBuilder, scene: ManipulationScene) -> RgbdSensor:
    lights = [
        LightParameter(type="directional", frame="camera", intensity=0.7),
        LightParameter(
            type="directional", frame="world", direction=[0.3, -0.2, -1.0], intensity=0.6
        ),
    ]
    renderer = MakeRenderEngineVtk(RenderEngineVtkParams(lights=lights))
    scene.scene_graph.AddRenderer("picture", renderer)
    core = RenderCameraCore(
        "picture",
        CameraInfo(_WIDTH, _HEIGHT, np.deg2rad(50.0)),
        ClippingRange(0.05, 10.0),
        RigidTransform(),
    )
    position, target = np.array([-0.45, 1.35, 1.75]), np.array([0.6, -0.1, 0.85])
    sensor = builder.AddSystem(
        RgbdSensor(
            scene.scene_graph.world_frame_id(),
            RigidTransform(se3.looking_at(position, target)),
            ColorRenderCamera(core),
            DepthRenderCamera(core, DepthRange(0.1, 9.0)),
        )
    )
    builder.Connect(scene.scene_graph.get_query_output_port(), sensor.query_object_input_port())
    return sensor


def _rendered(sensor: RgbdSensor, diagram: Diagram, root: Context) -> Array:
    image = sensor.color_image_output_port().Eval(sensor.GetMyContextFromRoot(root))
    return np.asarray(image.data)[:, :, :3].copy()
