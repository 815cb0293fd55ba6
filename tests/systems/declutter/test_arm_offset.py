"""Where an arm meets things beside where they are seen: closed forms, statistics, ports."""

from dataclasses import dataclass, field, replace

import numpy as np
import pytest
import shapely
from numpy.testing import assert_allclose
from pydrake.common.value import AbstractValue, Value
from pydrake.systems.framework import Context, InputPortIndex, OutputPortIndex
from scipy.stats import chi2

from crossmodal.maths.arrays import Array
from crossmodal.systems.declutter.arm_offset import (
    ArmOffsetConfig,
    ArmOffsetFilter,
    as_met,
    beyond_outlines,
    likelihood,
)
from crossmodal.systems.port_values import (
    ActionRequest,
    ArmOffset,
    DeclutterAction,
    Grasp,
    Push,
    Segments,
)
from tests.documented_ports import documented_ports
from tests.systems.declutter.scenes import image, rectangle

CONFIG = ArmOffsetConfig(outline=0.004, wrong=0.1)
PRIOR = np.array([[4e-5, 1e-5], [1e-5, 3e-5]])
BEFORE = np.block([[PRIOR, np.zeros((2, 1))], [np.zeros((1, 2)), 9e-6 * np.eye(1)]])
SCENE = image(rectangle(0, "can", (0.0, 0.0), (0.06, 0.04)), rectangle(1, "oil", (0.2, 0.1)))


@dataclass(frozen=True)
class End:
    """Of an action, as the filter reads it."""

    number: int
    contacts: Array = field(default_factory=lambda: np.zeros((0, 3)))


@pytest.fixture
def offset() -> ArmOffsetFilter:
    return ArmOffsetFilter(CONFIG, 0.1)


SEEN = ArmOffset(covariance=BEFORE)


def tick(
    offset: ArmOffsetFilter,
    context: Context,
    end: End,
    image_number: int | None = None,
    seen: ArmOffset = SEEN,
) -> ArmOffset:
    """After an action and an image that came after it."""
    offset.GetInputPort("arm_offset_seen").FixValue(context, AbstractValue.Make(seen))
    scene = replace(SCENE, number=end.number + 1 if image_number is None else image_number)
    offset.GetInputPort("segments").FixValue(context, AbstractValue.Make(scene))
    offset.GetInputPort("action_end").FixValue(context, Value[object](end))
    offset.ExecuteForcedEvents(context)
    found: ArmOffset = offset.GetOutputPort("arm_offset").Eval(context)
    return found


def test_distances_are_negative_within_an_outline() -> None:
    points = np.array([[0.0, 0.0], [0.05, 0.0], [0.03, 0.0], [0.0, 0.015]])
    assert_allclose(beyond_outlines(points, SCENE), [-0.02, 0.02, 0.0, -0.005], atol=1e-12)
    assert_allclose(beyond_outlines(points, Segments()), np.inf)


def test_what_is_met_at_an_outline_is_likeliest_there() -> None:
    beyond = np.linspace(-0.01, 0.01, 5)
    offsets = np.column_stack([-beyond, 0.0 * beyond])
    found = likelihood(np.array([0.03, 0.0, 0.0]), offsets, SCENE, CONFIG)
    density = np.exp(-0.5 * np.square(beyond / CONFIG.outline))
    assert_allclose(found, 0.9 * density + 0.1, atol=0.1)
    assert np.argmax(found) == 2


def test_what_a_finger_came_down_on_may_be_anywhere_within() -> None:
    offsets = np.array([[-0.05, 0.0], [0.0, 0.0], [0.02, 0.0]])
    found = likelihood(np.array([0.03, 0.0, np.inf]), offsets, SCENE, CONFIG)
    assert_allclose(found, [0.1, 0.55, 1.0], atol=1e-3)


def test_before_anything_was_met_it_is_what_was_seen(offset: ArmOffsetFilter) -> None:
    context = offset.CreateDefaultContext()
    found = tick(offset, context, End(0))
    assert_allclose(found.mean, 0.0, atol=1e-12)
    assert_allclose(found.covariance, BEFORE)
    contact = np.array([[0.035, 0.0, 0.0]])
    assert tick(offset, context, End(1, contact)).mean[0] > 1e-3
    seen = ArmOffset(mean=np.array([0.01, -0.02, 0.003]), covariance=0.1 * BEFORE, view=1)
    found = tick(offset, context, End(1, contact), 2, seen)
    assert_allclose(found.mean, seen.mean)
    assert_allclose(found.covariance, seen.covariance)
    assert found.view == 1
    # From there on contacts count again.
    contact = np.array([[0.045, 0.0, 0.0]])
    found = tick(offset, context, End(2, contact), 3, seen)
    assert found.mean[0] > 0.0102
    # They say nothing of heights.
    assert found.mean[2] == seen.mean[2]
    assert found.covariance[2, 2] == seen.covariance[2, 2]


def test_fingers_that_close_on_both_sides_tell_it_along_the_opening(
    offset: ArmOffsetFilter,
) -> None:
    """The can is met 5 mm farther along x; a push from below tells y."""
    context = offset.CreateDefaultContext()
    closed = End(1, np.array([[0.035, 0.0, 0.0], [-0.025, 0.0, 0.0]]))
    found = tick(offset, context, closed)
    assert found.mean[0] == pytest.approx(0.005, abs=1.5e-3)
    assert np.sqrt(found.covariance[0, 0]) < 0.004
    pushed = End(2, np.array([[0.0, -0.026, 0.0]]))
    found = tick(offset, context, pushed)
    assert found.mean[1] == pytest.approx(-0.004, abs=2e-3)


def test_an_action_is_counted_once(offset: ArmOffsetFilter) -> None:
    context = offset.CreateDefaultContext()
    end = End(1, np.array([[0.035, 0.0, 0.0]]))
    first = tick(offset, context, end)
    for image_number in (2, 3):
        assert_allclose(tick(offset, context, end, image_number).mean, first.mean)
    assert tick(offset, context, End(2, end.contacts), 4).mean[0] > first.mean[0]


def test_what_was_met_is_compared_with_the_image_after_it(offset: ArmOffsetFilter) -> None:
    context = offset.CreateDefaultContext()
    tick(offset, context, End(0), 1)
    end = End(1, np.array([[0.035, 0.0, 0.0]]))
    assert_allclose(tick(offset, context, end, 1).mean, 0.0, atol=1e-12)
    assert tick(offset, context, end, 2).mean[0] > 1e-3


def test_a_contact_far_from_everything_says_nothing(offset: ArmOffsetFilter) -> None:
    found = tick(offset, offset.CreateDefaultContext(), End(1, np.array([[0.5, 0.5, 0.0]])))
    assert_allclose(found.mean, 0.0, atol=1e-9)
    assert_allclose(found.covariance, BEFORE, rtol=5e-3, atol=1e-12)


def test_its_claims_hold() -> None:
    """Offsets by the prior; contacts on outlines that err, a tenth of which is wrong."""
    rng, inside, misses = np.random.default_rng(0), 0, list[Array]()
    root, count = np.linalg.cholesky(PRIOR), 200
    outline = SCENE.segments[0].contour.exterior
    for _ in range(count):
        truth = root @ rng.standard_normal(2)
        offset = ArmOffsetFilter(CONFIG, 0.1)
        context = offset.CreateDefaultContext()
        for number in (1, 2, 3):
            at, ahead = (
                shapely.get_coordinates(outline.interpolate(s, normalized=True))[0]
                for s in np.array([0.0, 1e-4]) + rng.uniform(0.0, 0.999)
            )
            along = (ahead - at) / np.linalg.norm(ahead - at)
            outward = -np.array([-along[1], along[0]]) * (1.0 if outline.is_ccw else -1.0)
            if rng.random() < CONFIG.wrong:
                at = at + rng.uniform(-0.03, 0.03, 2)
            depth = rng.choice([0.0, 0.01])
            p = at + (rng.normal(0.0, CONFIG.outline) - rng.uniform(0.0, depth)) * outward + truth
            found = tick(offset, context, End(number, np.array([[*p, depth]])))
        miss = found.mean[:2] - truth
        misses.append(miss)
        inside += int(miss @ np.linalg.solve(found.covariance[:2, :2], miss) < chi2.ppf(0.95, 2))
    assert 0.90 * count < inside < 0.985 * count
    assert np.square(misses).sum(axis=1).mean() < 0.7 * np.trace(PRIOR)


def test_a_request_is_displaced_as_a_whole() -> None:
    push = Push(
        point=np.array([0.1, 0.2]),
        direction=np.array([1.0, 0.0]),
        length=0.1,
        height=0.02,
        place=np.array([0.0, 0.2]),
        finger=shapely.box(0.0, 0.0, 1.0, 1.0),
    )
    request = ActionRequest(
        number=3,
        action=DeclutterAction.GRASP,
        grasps=(Grasp(X_WE=np.eye(4), width=0.05, quality=1.0),),
        pushes=(push,),
        places=np.array([[0.5, 0.0]]),
        top=0.1,
        obstacles=(np.array([[0.0, 0.0, 0.1]]),),
    )
    arm = ArmOffset(mean=np.array([0.01, -0.02, 0.003]))
    met = as_met(request, arm, table=-0.001)
    assert_allclose(met.grasps[0].X_WE[:3, 3], [0.01, -0.02, 0.003])
    assert_allclose(met.pushes[0].point, [0.11, 0.18])
    assert_allclose(met.pushes[0].place, [0.01, 0.18])
    assert_allclose(met.pushes[0].direction, push.direction)
    assert_allclose(met.pushes[0].finger.bounds, [0.01, -0.02, 1.01, 0.98])
    # Heights of pushes and objects are above the table, others in W.
    assert_allclose([met.pushes[0].height, met.top], [0.022, 0.102])
    assert_allclose(met.places, [[0.51, -0.02]])
    assert_allclose(met.obstacles[0], [[0.01, -0.02, 0.103]])
    assert met.number == 3


def test_the_table_is_met_as_near_as_its_height_is_known() -> None:
    arm = ArmOffset(covariance=np.diag([0.0, 0.0, 9e-6]))
    assert as_met(ActionRequest(landing=0.005), arm).landing == pytest.approx(0.009)
    assert as_met(ActionRequest(landing=0.02), arm).landing == 0.02


def test_documented_ports_are_the_declared_ones(offset: ArmOffsetFilter) -> None:
    inputs = [offset.get_input_port(InputPortIndex(i)).get_name() for i in range(3)]
    outputs = [offset.get_output_port(OutputPortIndex(0)).get_name()]
    assert (offset.num_input_ports(), offset.num_output_ports()) == (3, 1)
    assert documented_ports(ArmOffsetFilter.__doc__, "input") == inputs
    assert documented_ports(ArmOffsetFilter.__doc__, "output") == outputs


def test_impossible_configurations_are_refused() -> None:
    with pytest.raises(ValueError, match="outline = 0"):
        ArmOffsetFilter(ArmOffsetConfig(outline=0.0), 0.1)
