"""How two fingers close and hold, against an object between them that is a stiff spring."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from crossmodal.controllers.primitives.grip import FingerForces, Grip, finger_forces
from crossmodal.controllers.primitives.move_object_config import GripConfig
from crossmodal.maths.arrays import Array
from crossmodal.models.gripper_taxels import gripper_taxels, tip_taxels

CONFIG, PERIOD = GripConfig(), 0.005
OPEN = np.full(2, 0.05)
OBJECT = 12000.0  # Stiffness of four taxels, [N/m].


def grip_of(sides: Array, shear: Array, seconds: float = 2.0, feels: bool = True) -> Grip:
    """The grip of an object from sides[1] left of the middle to sides[0] right of it, [m]."""
    grip = Grip(command=OPEN)
    for step in range(round(seconds / PERIOD)):
        free = np.maximum(grip.command, 0.0)
        pressed = (CONFIG.stiffness * grip.command + OBJECT * sides) / (CONFIG.stiffness + OBJECT)
        fingers = np.where(grip.command < sides, pressed, free)
        normal = np.clip(OBJECT * (sides - fingers), 0.0, None) * feels
        grip = grip.closing(
            FingerForces(normal=normal, shear=shear), fingers, step * PERIOD, PERIOD, CONFIG
        )
    return grip


def pressed_with(grip: Grip, sides: Array) -> Array:
    return (sides - grip.command) / (1.0 / CONFIG.stiffness + 1.0 / OBJECT)


@pytest.mark.parametrize("sides", [[0.03, 0.03], [0.035, 0.02]], ids=["middle", "aside"])
def test_fingers_press_alike_and_move_nothing(sides: list[float]) -> None:
    grip = grip_of(np.array(sides), np.zeros(2))
    assert grip.met.all()
    assert_allclose(pressed_with(grip, np.array(sides)), CONFIG.force, rtol=0.15)


def test_they_press_more_under_a_load_and_never_more_than_they_may() -> None:
    sides = np.array([0.03, 0.03])
    loaded = grip_of(sides, np.array([0.0, 6.0]))
    assert_allclose(pressed_with(loaded, sides), 0.5 * 6.0 / CONFIG.load, rtol=0.1)
    heavy = grip_of(sides, np.array([0.0, 12.0]))
    assert_allclose(pressed_with(heavy, sides), CONFIG.largest_force, rtol=0.1)


def test_what_no_taxel_feels_is_met_and_not_crushed() -> None:
    sides = np.array([0.03, 0.03])
    grip = grip_of(sides, np.zeros(2), feels=False)
    assert grip.met.all()
    assert np.all(pressed_with(grip, sides) < 1.05 * CONFIG.largest_force)
    nothing = FingerForces(normal=np.zeros(2), shear=np.zeros(2))
    assert grip.has(nothing, sides, CONFIG)
    assert not grip_of(np.zeros(2), np.zeros(2)).has(nothing, np.zeros(2), CONFIG)


@pytest.mark.parametrize("felt", [1.0, 0.3], ids=["all is felt", "much is not felt"])
def test_what_pushes_the_object_to_a_side_hardly_moves_it(felt: float) -> None:
    """The object is between springs; what its edges press with is not felt."""
    half, place, push = 0.02, 0.0, 3.0
    grip = Grip(command=np.full(2, half), met=np.ones(2, bool), force=CONFIG.force)
    for _ in range(400):
        sides = half + np.array([place, -place])
        fingers = (CONFIG.stiffness * grip.command + OBJECT * sides) / (CONFIG.stiffness + OBJECT)
        pressed = OBJECT * (sides - fingers)
        place += 1e-5 * (push + pressed[1] - pressed[0])  # It gives way slowly.
        forces = FingerForces(normal=felt * pressed, shear=np.zeros(2))
        grip = grip.pressing(forces, fingers, PERIOD, CONFIG)
    assert place == pytest.approx(0.5 * push * (1.0 / CONFIG.stiffness + 1.0 / OBJECT), rel=0.1)


def test_fingers_that_meet_nothing_close() -> None:
    grip = grip_of(np.zeros(2), np.zeros(2))
    assert np.isfinite(grip.since)


@pytest.mark.parametrize(
    ("normal", "load", "width", "force", "holds"),
    [
        (10.0, 3.0, 0.06, 5.0, True),
        (3.0, 1.0, 0.06, 5.0, False),
        (10.0, 3.0, 0.05, 5.0, True),  # It has turned between the fingers.
        (10.0, 3.0, 0.002, 5.0, False),
        (18.0, 10.0, 0.06, 9.0, False),
        (10.0, 5.5, 0.06, 6.9, True),
    ],
    ids=["held", "weak", "narrower", "closed", "slips", "more force follows"],
)
def test_something_is_held_or_not(
    normal: float, load: float, width: float, force: float, holds: bool
) -> None:
    fingers = np.full(2, 0.5 * width)
    grip = Grip(met=np.ones(2, bool), force=force, command=fingers)
    forces = FingerForces(normal=np.full(2, 0.5 * normal), shear=np.array([0.0, load]))
    has = grip.has(forces, fingers, CONFIG)
    assert (has and not grip.slips(forces, CONFIG)) == holds


def test_forces_are_those_from_between_the_fingers() -> None:
    layout = gripper_taxels()
    forces = np.zeros((140, 3))
    inner = np.flatnonzero((layout.n_F[:, 0] == -1.0) & (layout.finger == 0))[:4]
    forces[inner] = [1.0, 0.0, 0.25]
    forces[np.flatnonzero((layout.n_F[:, 0] == 1.0) & (layout.finger == 0))[0]] = [-3.0, 1.0, 0.0]
    # The table presses the fingers' ends, which rub on it.
    forces[tip_taxels()] = [0.5, 0.0, -1.0]
    found = finger_forces(forces, noise=0.01)
    assert_allclose(found.normal, [4.0, 0.0])
    assert_allclose(found.shear, [0.0, 1.0])
