"""Draws what is sensed and believed of the flap into Meshcat, live and in the recording."""

from collections.abc import Mapping, Sequence

import numpy as np
from pydrake.geometry import Box, Cylinder, Meshcat, Rgba, Sphere
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.systems.framework import (
    Context,
    Diagram,
    DiagramBuilder,
    InputPort,
    LeafSystem,
    System,
)

from crossmodal.diagrams.drawing import palette
from crossmodal.diagrams.drawing.layers import Layers, Viewpoint
from crossmodal.diagrams.drawing.legend import Entry, show_legend
from crossmodal.diagrams.drawing.meshcat import (
    ROOT,
    TRUTH,
    clear_view,
    estimator_layers,
    frame_along,
    legend_title,
)
from crossmodal.diagrams.flap.estimator_names import COLORS, LABELS
from crossmodal.diagrams.flap.scenario import Scenario
from crossmodal.diagrams.flap.truth import UNKNOWN_FLAP, FlapTruth
from crossmodal.diagrams.run.recorder import declare_input, read_inputs
from crossmodal.diagrams.run.wiring import connect_latest
from crossmodal.maths.arrays import Array
from crossmodal.systems.port_values import (
    UNKNOWN_FINGERTIP,
    UNKNOWN_TOOL,
    FingertipContact,
    FlapPlane,
    ToolBelief,
    unseen,
)
from crossmodal.systems.tactile.taxel_layout import TaxelLayout

_PERIOD = 0.1  # Between drawings, [s].
_STRONGEST = 0.3  # Force of a red taxel, [N].
# From where the page is first seen.
VIEWPOINT = Viewpoint(p_WV=np.array([1.25, 0.55, 0.75]), p_WT=np.array([0.5, 0.0, 0.45]))
_AXIS_LENGTH = 0.3  # [m]
_L1, _L2, _PLANE = "#228833", "#EE7733", "#66CCEE"
_LINE, _TIP = "#EEEEEE", "#CCBB44"
_BEADS, _SPACING = 150, 0.006  # Of the tip's path, and the way between two of them, [m].
_LEGEND: list[Entry] = [
    ("dot", "#CC3311", "taxel, the redder the harder it is pressed"),
    ("bar", _PLANE, "plane of the flap as the camera sees it"),
    ("bar", COLORS["filtered"], "hinge axis k"),
    ("bar", _L1, "L1: end-effector to hinge"),
    ("bar", _L2, "L2: contact to hinge"),
    ("bar", _LINE, "line that the tip is to follow"),
    ("dot", _TIP, "where the arm believes the tip has been"),
    ("bar", palette.TRUTH, "the true hinge axis, if it is shown; ball: the true contact"),
]


def add_view(
    builder: DiagramBuilder,
    scenario: Scenario,
    meshcat: Meshcat,
    station: Diagram,
    estimators: Mapping[str, System],
) -> Layers:
    """Adds a view of what is sensed and of what the estimators believe."""
    view = builder.AddNamedSystem(
        "meshcat_view",
        MeshcatView(
            meshcat,
            list(estimators),
            scenario.finger.layout(),
            (scenario.control.line.start, scenario.control.line.end),
        ),
    )
    for port in ("taxel_measured", "tip_estimated", "cheat_flap"):
        builder.Connect(station.GetOutputPort(port), view.GetInputPort(port))
    connect_latest(builder, estimators, view)
    return Layers(estimators=estimator_layers(estimators, LABELS), truth=TRUTH)


class MeshcatView(LeafSystem):
    """Draws taxels, the flap's plane, hinge, L1 and L2, and the tip on its line into Meshcat.

    Plane, hinge, L1 and L2 are those of a tool that is held still: they vanish once the tool has
    become a link of the arm.

    What has been drawn is kept outside the Context, so one view serves one simulation.

    Input ports:
    - `taxel_measured`: forces (taxels,), [N].
    - `tip_estimated`: p_WT of the tool's tip (3,), [m]; NaN before the arm has the tool as a link.
    - `cheat_flap`: `FlapTruth`, of which hinge axis and contact are drawn for whom wants them.
    - `<estimator>_tool_latest`: `ToolBelief`.
    - `<estimator>_flap_plane_latest`: `FlapPlane`.
    - `<estimator>_fingertip_contact_latest`: `FingertipContact`; its pose places the taxels.

    Frames: W world, S fingertip, T taxel, F flap, K hinge, C contact.

    Args:
        estimators: Names; the last is shown first.
        line: Ends of the line that the tip is to follow, (3,) each, [m].
    """

    def __init__(
        self,
        meshcat: Meshcat,
        estimators: Sequence[str],
        layout: TaxelLayout,
        line: tuple[Array, Array],
    ) -> None:
        super().__init__()
        self._meshcat, self._layout = meshcat, layout
        clear_view(meshcat, VIEWPOINT)
        self._beads: list[Array] = []  # Where the path's first ones lie.
        self._tip = self.DeclareVectorInputPort("tip_estimated", 3)
        self._taxels = self.DeclareVectorInputPort("taxel_measured", len(self._layout.p_ST))
        self._truth = declare_input(self, "cheat_flap", UNKNOWN_FLAP)
        models = {
            "tool": UNKNOWN_TOOL,
            "flap_plane": unseen(""),
            "fingertip_contact": UNKNOWN_FINGERTIP,
        }
        self._ports: dict[str, dict[str, InputPort]] = {
            name: {
                port: declare_input(self, f"{name}_{port}_latest", model)
                for port, model in models.items()
            }
            for name in estimators
        }
        for index in range(len(self._layout.p_ST)):
            meshcat.SetObject(f"{ROOT}/taxels/{index}", Sphere(0.0018), Rgba(0.3, 0.3, 0.3, 1.0))
        self._make_line(*line)
        self._make_truth()
        for name in estimators:
            self._make_layer(name, visible=name == list(estimators)[-1])
        shown = estimators[-1] if estimators else ""
        show_legend(meshcat, legend_title(shown, LABELS), _LEGEND)
        self.DeclarePeriodicPublishEvent(_PERIOD, 0.0, self._draw)

    def _make_layer(self, name: str, visible: bool) -> None:
        path = f"{ROOT}/{name}"
        axis = COLORS.get(name, palette.QUIET)
        for part, color in (("axis", axis), ("L1", _L1), ("L2", _L2)):
            rgba = Rgba(*palette.rgb(color))
            self._meshcat.SetObject(f"{path}/{part}/bar", Cylinder(0.003, 1.0), rgba)
        plane = Rgba(*palette.rgb(_PLANE), 0.4)
        self._meshcat.SetObject(f"{path}/plane", Box(0.2, 0.1, 0.001), plane)
        self._meshcat.SetProperty(path, "visible", visible)

    def _make_line(self, p_WA: Array, p_WB: Array) -> None:
        self._meshcat.SetObject(
            f"{ROOT}/line/bar", Cylinder(0.0015, 1.0), Rgba(*palette.rgb(_LINE))
        )
        self._place_bar(0.0, f"{ROOT}/line", p_WA, p_WB)
        for index in range(_BEADS):
            path = f"{ROOT}/tip/{index}"
            self._meshcat.SetObject(path, Sphere(0.0025), Rgba(*palette.rgb(_TIP)))
            self._meshcat.SetProperty(path, "visible", False, 0.0)

    def _make_truth(self) -> None:
        color = Rgba(*palette.rgb(palette.TRUTH))
        self._meshcat.SetObject(f"{TRUTH}/axis/bar", Cylinder(0.002, 1.2 * _AXIS_LENGTH), color)
        self._meshcat.SetObject(f"{TRUTH}/contact/ball", Sphere(0.004), color)

    def _draw_truth(self, time: float, truth: FlapTruth) -> None:
        for part, known in (("axis", truth.p_WK), ("contact", truth.p_WC)):
            path, is_known = f"{TRUTH}/{part}", bool(np.isfinite(known).all())
            self._meshcat.SetProperty(path, "visible", is_known, time)
            if is_known:
                R = frame_along(truth.k_W) if part == "axis" else RotationMatrix()
                self._meshcat.SetTransform(path, RigidTransform(R, known), time)

    def _draw_tip(self, time: float, p_WT: Array) -> None:
        """Puts the next bead of the tip's path where the tip is, if it has come far enough."""
        count = len(self._beads)
        far = count == 0 or np.linalg.norm(p_WT - self._beads[-1]) >= _SPACING
        if count < _BEADS and far and np.isfinite(p_WT).all():
            self._beads.append(p_WT.copy())
            self._meshcat.SetTransform(f"{ROOT}/tip/{count}", RigidTransform(p_WT), time)
            self._meshcat.SetProperty(f"{ROOT}/tip/{count}", "visible", True, time)

    def _draw(self, context: Context) -> None:
        time = context.get_time()
        drawn = False
        p_WT = np.asarray(self._tip.Eval(context))
        held_still = not np.isfinite(p_WT).all()
        self._draw_tip(time, p_WT)
        if self._truth.HasValue(context):
            self._draw_truth(time, self._truth.Eval(context))
        for name, ports in self._ports.items():
            values = read_inputs(ports, context)
            fingertip = values.get("fingertip_contact", UNKNOWN_FINGERTIP)
            if not drawn and np.isfinite(fingertip.X_WS).all():
                self._draw_taxels(time, np.asarray(self._taxels.Eval(context)), fingertip)
                drawn = True
            tool, plane = values.get("tool", UNKNOWN_TOOL), values.get("flap_plane", unseen(""))
            self._draw_tool(time, f"{ROOT}/{name}", tool if held_still else UNKNOWN_TOOL)
            self._draw_plane(time, f"{ROOT}/{name}/plane", plane if held_still else unseen(""))

    def _draw_taxels(self, time: float, forces: Array, fingertip: FingertipContact) -> None:
        R, p = fingertip.X_WS[:3, :3], fingertip.X_WS[:3, 3]
        for index, (place, force) in enumerate(zip(self._layout.p_ST, forces, strict=True)):
            path = f"{ROOT}/taxels/{index}"
            self._meshcat.SetTransform(path, RigidTransform(p + R @ place), time)
            share = float(np.clip(force / _STRONGEST, 0.0, 1.0))
            color = (1.0 - share) * np.array([0.3, 0.3, 0.3]) + share * np.array([0.8, 0.2, 0.07])
            self._meshcat.SetProperty(path, "color", [*color.tolist(), 1.0], time)

    def _draw_tool(self, time: float, path: str, tool: ToolBelief) -> None:
        known = tool.hinge.known and np.isfinite(tool.L1_W).all()
        for part in ("axis", "L1", "L2"):
            self._meshcat.SetProperty(f"{path}/{part}", "visible", bool(known), time)
        if not known:
            return
        k, p = tool.hinge.k_W, tool.hinge.p_WK
        half = 0.5 * _AXIS_LENGTH * k
        self._place_bar(time, f"{path}/axis", p - half, p + half)
        self._place_bar(time, f"{path}/L1", p - tool.L1_W, p)
        self._place_bar(time, f"{path}/L2", p - tool.L2_W, p)

    def _place_bar(self, time: float, path: str, p_WA: Array, p_WB: Array) -> None:
        """Stretches a bar of unit length from A to B."""
        way = p_WB - p_WA
        length = max(float(np.linalg.norm(way)), 1e-4)
        X_WB = RigidTransform(frame_along(way / length), 0.5 * (p_WA + p_WB))
        self._meshcat.SetTransform(path, X_WB, time)
        self._meshcat.SetProperty(f"{path}/bar", "scale", [1.0, 1.0, length], time)

    def _draw_plane(self, time: float, path: str, plane: FlapPlane) -> None:
        self._meshcat.SetProperty(path, "visible", plane.seen, time)
        if plane.seen:
            X_WF = RigidTransform(frame_along(plane.n_W), plane.p_WF)
            self._meshcat.SetTransform(path, X_WF, time)
