"""What the 3D page shows of the tool's tip."""

from unittest.mock import Mock

import numpy as np
from numpy.testing import assert_allclose
from pydrake.systems.analysis import Simulator

from crossmodal.diagrams.flap.meshcat_view import MeshcatView
from crossmodal.systems.tactile.taxel_layout import fingertip_layout

LINE = np.array([0.6, 0.0, 0.2]), np.array([0.4, 0.0, 0.2])


def placed(meshcat: Mock, path: str) -> list[np.ndarray]:
    """Where what has a path that begins so was put (3,), [m], in order."""
    calls = [call.args for call in meshcat.SetTransform.call_args_list]
    return [args[1].translation() for args in calls if args[0].startswith(f"/perception/{path}")]


def test_the_tip_leaves_a_bead_every_few_millimetres_and_the_line_lies_between_its_ends() -> None:
    meshcat = Mock()
    view = MeshcatView(meshcat, [], fingertip_layout(), LINE)
    simulator = Simulator(view)
    context = simulator.get_mutable_context()
    assert_allclose(placed(meshcat, "line"), [[0.5, 0.0, 0.2]])
    for time, x in ((0.0, np.nan), (0.1, 0.6), (0.2, 0.598), (0.3, 0.59), (0.4, 0.58)):
        view.GetInputPort("tip_estimated").FixValue(context, np.array([x, 0.0, 0.2]))
        simulator.AdvanceTo(time + 0.05)
    assert_allclose(placed(meshcat, "tip"), [[0.6, 0, 0.2], [0.59, 0, 0.2], [0.58, 0, 0.2]])
    shown = [call.args for call in meshcat.SetProperty.call_args_list if call.args[2] is True]
    assert [args[0] for args in shown] == [f"/perception/tip/{index}" for index in range(3)]
    assert_allclose([args[3] for args in shown], [0.1, 0.3, 0.4])
