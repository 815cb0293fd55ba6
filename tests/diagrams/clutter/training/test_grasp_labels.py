import numpy as np
import pytest
from numpy.testing import assert_allclose
from trimesh.creation import box, cylinder

from crossmodal.diagrams.clutter.training.grasp_data import Body, body_at, true_heights
from crossmodal.diagrams.clutter.training.grasp_labels import (
    PAD_FRICTION,
    find_contacts,
    find_grasps,
    grip_force,
)
from crossmodal.diagrams.clutter.training.shapes import Shape, make_shape
from crossmodal.maths.arrays import Array, Mask
from crossmodal.systems.grasping.grasp_geometry import MARGIN, STROKE, is_blocked
from crossmodal.systems.grasping.height_map import CELL, CELLS, HeightMap

SIZE = np.array([0.16, 0.05, 0.06])


def block(mass: float = 0.1, friction: float = 0.5, size: Array = SIZE) -> Shape:
    mesh = box(extents=size)
    mesh.apply_translation([0.0, 0.0, 0.5 * size[2]])
    middle = np.array([0.0, 0.0, 0.5 * size[2]])
    return make_shape("", np.asarray(mesh.triangles), middle, mass, friction, False)


def tin(radius: float) -> Shape:
    mesh = cylinder(radius=radius, height=0.1, sections=96)
    mesh.apply_translation([0.0, 0.0, 0.05])
    middle = np.array([0.0, 0.0, 0.05])
    return make_shape("", np.asarray(mesh.triangles), middle, 0.2, 0.5, False)


def holds(shape: Shape, *grasps: tuple[float, float, float, float, float]) -> Mask:
    return find_contacts(shape, shape.corners, shape.p_OCm, np.array(grasps)).holds


def view_of(body: Body) -> HeightMap:
    corner = np.full(2, -0.5 * (CELLS - 1) * CELL)
    heights = true_heights([body], corner)
    return HeightMap(heights=heights, others=np.zeros_like(heights), corner=corner)


def grasps_of(shape: Shape) -> Array:
    body = body_at(shape, np.eye(4))
    view = view_of(body)
    rng = np.random.default_rng(0)
    return find_grasps(shape, body.corners, body.p_WCm, view, view.heights, 400, rng)[0]


def test_a_box_is_held_at_its_parallel_sides_and_not_askew() -> None:
    across = np.pi / 2
    angles = across + np.deg2rad([0.0, 5.0, 30.0, 45.0])
    assert_allclose(
        holds(block(), *[(0.0, 0.0, angle, 0.12, 0.015) for angle in angles]),
        [True, True, False, False],
    )


def test_the_contacts_are_where_the_sides_are() -> None:
    grasp = np.array([[0.0, 0.01, np.pi / 2, 0.1, 0.015]])
    contacts = find_contacts(block(), block().corners, block().p_OCm, grasp)
    assert_allclose(contacts.width, SIZE[1], atol=1e-9)
    assert_allclose(contacts.middle, -0.01, atol=1e-9)
    assert_allclose(contacts.askew, 0.0, atol=1e-9)


def test_an_object_wider_than_the_fingers_open_is_not_held() -> None:
    wide = block(size=np.array([0.2, 0.145, 0.06]))
    assert not holds(wide, (0.0, 0.0, np.pi / 2, STROKE, 0.015))[0]
    assert len(grasps_of(wide)) == 0
    assert len(grasps_of(block(size=np.array([0.2, STROKE - 2.0 * MARGIN - 1e-3, 0.06])))) > 0


def test_the_grip_grows_with_what_it_carries() -> None:
    assert grip_force(0.1) == 5.0
    # Shear over normal is .4 then.
    assert grip_force(0.6) == pytest.approx(0.5 * 0.6 * 9.81 / 0.4)
    assert grip_force(2.0) == 9.0


def test_a_heavy_object_slips() -> None:
    friction = 2.0 * PAD_FRICTION * 0.5 / (PAD_FRICTION + 0.5)
    heaviest = 2.0 * friction * grip_force(2.0) / 9.81
    assert heaviest == pytest.approx(1.129, abs=1e-3)
    grasp = (0.0, 0.0, np.pi / 2, 0.07, 0.015)
    size = np.array([0.03, 0.05, 0.06])
    assert holds(block(0.8 * heaviest, size=size), grasp)[0]
    assert not holds(block(1.01 * heaviest, size=size), grasp)[0]


def test_an_object_grasped_beside_its_middle_turns() -> None:
    long = block(0.2, size=np.array([0.2, 0.03, 0.06]))
    places = [0.0, 0.005, 0.03, 0.08]
    assert_allclose(
        holds(long, *[(x, 0.0, np.pi / 2, 0.05, 0.015) for x in places]),
        [True, True, False, False],
    )
    light = block(0.01, size=np.array([0.2, 0.03, 0.06]))
    assert holds(light, (0.08, 0.0, np.pi / 2, 0.05, 0.015))[0]


def test_a_round_object_is_held_at_its_middle_from_all_sides_and_not_beside_it() -> None:
    angles = np.linspace(0.0, np.pi, 7)
    assert holds(tin(0.03), *[(0.0, 0.0, angle, 0.08, 0.055) for angle in angles]).all()
    assert not holds(tin(0.03), (0.0, 0.025, 0.0, 0.08, 0.055))[0]


def test_a_grasp_above_the_object_meets_nothing() -> None:
    contacts = find_contacts(
        block(), block().corners, block().p_OCm, np.array([[0.0, 0.0, 0.0, 0.12, 0.07]])
    )
    assert np.isnan(contacts.middle[0])
    assert not contacts.holds[0]


def test_the_grasps_found_are_centred_and_leave_room() -> None:
    grasps = grasps_of(block())
    assert len(grasps) > 5
    assert_allclose(grasps[:, 1], 0.0, atol=0.006)
    assert_allclose(np.abs(grasps[:, 2] - np.pi / 2), 0.0, atol=np.deg2rad(26.0))
    assert (grasps[:, 3] >= SIZE[1] + 2.0 * MARGIN - 1e-6).all()
    assert_allclose(grasps[:, 4], 0.015, atol=1e-6)


def test_against_a_wall_no_finger_finds_room() -> None:
    body, grasps = body_at(block(), np.eye(4)), grasps_of(block())
    X_WWall = np.eye(4)
    X_WWall[1, 3] = 0.5 * SIZE[1] + 0.012
    wall = body_at(block(size=np.array([0.3, 0.02, 0.1])), X_WWall)
    view = view_of(body)
    assert is_blocked(true_heights([wall], view.corner), grasps, view).all()
    X_WWall[1, 3] += 0.06
    wall = body_at(wall.shape, X_WWall)
    assert not is_blocked(true_heights([wall], view.corner), grasps, view).any()
