import numpy as np
from numpy.testing import assert_allclose

from crossmodal.diagrams.flap.perceived_tool import perceived_tool
from crossmodal.diagrams.run.record import Tick
from crossmodal.maths import se3
from crossmodal.systems.flap.tool_kinematics import pose
from crossmodal.systems.object_models.sdf import sdf
from crossmodal.systems.port_values import FlapAngleBelief, HingeBelief, ToolBelief

LENGTH = 0.12
X_WE = se3.exp(np.array([0.4, -0.7, 1.2, 0.5, 0.2, 0.9]))
X_EK = se3.exp(np.array([-0.3, 0.2, 0.5, 0.1, -0.05, 0.2]))


def _tool(theta: float) -> ToolBelief:
    turn = se3.so3_exp(np.array([0.0, 0.0, theta]))
    X_KT = pose(turn, turn @ [LENGTH, 0.0, 0.0])
    X_WK = X_WE @ X_EK
    hinge = HingeBelief(known=True, k_W=X_WK[:3, 2], p_WK=X_WK[:3, 3], covariance=1e-4 * np.eye(6))
    return ToolBelief(
        hinge=hinge,
        angle=FlapAngleBelief(known=True, theta=theta, variance=4e-4),
        L2_W=-X_WK[:3, :3] @ X_KT[:3, 3],
        L1_covariance=1e-6 * np.eye(3),
        L2_covariance=1e-6 * np.eye(3),
        X_EK=X_EK,
        X_KT=X_KT,
    )


def test_the_flap_turns_about_the_hinge_of_the_holder() -> None:
    found = None
    for theta in (-0.2, 0.9, 0.6):
        tool = _tool(theta)
        found = perceived_tool(found, Tick(time=theta, values={"tool_latest": tool}))
        assert found is not None
        assert_allclose(found.X_WR, X_WE, atol=1e-9)
        assert_allclose(found.joints[0].pose(theta), tool.X_EK @ tool.X_KT, atol=1e-9)
        assert_allclose(found.bodies[0].X_WB, X_WE @ tool.X_EK @ tool.X_KT, atol=1e-9)
    assert found is not None
    (hinge,) = found.joints
    assert (hinge.lower, hinge.upper, hinge.q) == (-0.2, 0.9, 0.6)
    assert (hinge.parent, hinge.child, hinge.type) == ("holder", "flap", "revolute")
    text = sdf(found, "tool")
    assert "hinge: revolute -->" in text  # No other type was considered.
    assert "0.12 0.005 0.005" in text


def test_a_tool_that_is_not_known_stays_as_it_was() -> None:
    before = perceived_tool(None, Tick(time=0.0, values={"tool_latest": _tool(0.4)}))
    assert perceived_tool(before, Tick(time=1.0, values={})) is before
    assert perceived_tool(None, Tick(time=1.0, values={})) is None
