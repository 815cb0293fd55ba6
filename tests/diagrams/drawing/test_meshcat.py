from unittest.mock import Mock, call

import numpy as np
import pytest

from crossmodal.diagrams.drawing.layers import Viewpoint
from crossmodal.diagrams.drawing.meshcat import (
    ROOT,
    TRUTH,
    clear_view,
    legend_title,
    rigid_transform,
    show_from,
    start_meshcat,
)


def test_the_server_is_for_this_machine_only() -> None:
    assert "localhost" in start_meshcat().web_url()


def test_an_interface_that_there_is_not_is_refused() -> None:
    with pytest.raises(RuntimeError, match="this machine has no such address"):
        start_meshcat("203.0.113.7")


def test_a_name_that_nobody_has_is_refused_at_once() -> None:
    with pytest.raises(RuntimeError, match="the name is not known"):
        start_meshcat("nope.invalid")


def test_a_slightly_skewed_rotation_becomes_a_pose() -> None:
    X = np.eye(4)
    X[:3, :3] += 1e-9
    X[:3, 3] = [1.0, 2.0, 3.0]
    assert rigid_transform(X).translation().tolist() == [1.0, 2.0, 3.0]


def test_a_view_begins_without_what_an_earlier_one_left() -> None:
    meshcat = Mock()
    clear_view(meshcat, Viewpoint(p_WV=np.zeros(3), p_WT=np.ones(3)))
    assert {call.args[0] for call in meshcat.Delete.call_args_list} == {ROOT, TRUTH}
    meshcat.SetProperty.assert_called_once_with(TRUTH, "visible", False)
    meshcat.SetCameraPose.assert_called_once()


def test_an_object_appears_when_it_was_made() -> None:
    meshcat = Mock()
    show_from(meshcat, "late", 2.0)
    assert meshcat.SetProperty.call_args_list == [
        call("late", "visible", False, 0.0),
        call("late", "visible", True, 2.0),
    ]


def test_the_title_names_whose_beliefs_are_shown() -> None:
    assert legend_title("eye", {"eye": "vision"}).startswith("as believed by vision;")
    assert legend_title("ear", {}).startswith("as believed by ear;")
