"""An image arrives a latency after it was taken, and only its own instants are rendered."""

import numpy as np
import pytest
from pydrake.common.value import Value
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder, LeafSystem
from pydrake.systems.sensors import ImageDepth32F

from crossmodal.systems.sensors.image_delay import ImageDelay

MODEL = Value[ImageDepth32F](ImageDepth32F(1, 1))
TICK = 0.1


class Clock(LeafSystem):
    """An image that shows when it was rendered."""

    def __init__(self) -> None:
        super().__init__()
        self.rendered: list[float] = []
        self.DeclareAbstractOutputPort("image", MODEL.Clone, self._render, {self.time_ticket()})

    def _render(self, context, output) -> None:
        self.rendered.append(context.get_time())
        output.get_mutable_value().mutable_data[:] = context.get_time()


@pytest.mark.parametrize(
    ("latency", "shown"), [(0.04, [0.0, 0.06, 0.16, 0.26]), (0.12, [0.0, 0.0, 0.08, 0.18])]
)
def test_a_tick_gets_the_image_that_was_taken_a_latency_before(
    latency: float, shown: list[float]
) -> None:
    builder = DiagramBuilder()
    clock = builder.AddSystem(Clock())
    delay = builder.AddSystem(ImageDelay(MODEL, latency, TICK))
    builder.Connect(clock.get_output_port(), delay.get_input_port())
    simulator = Simulator(builder.Build())
    found = []
    for tick in range(4):
        simulator.AdvanceTo(tick * TICK)
        context = delay.GetMyContextFromRoot(simulator.get_context())
        found.append(float(delay.get_output_port().Eval(context).data.item()))
    np.testing.assert_allclose(found, shown, atol=1e-6)
    assert len(clock.rendered) <= len(shown)


@pytest.mark.parametrize(("latency", "period"), [(0.0, TICK), (0.04, 0.0), (np.nan, TICK)])
def test_an_impossible_latency_or_period_is_refused(latency: float, period: float) -> None:
    with pytest.raises(ValueError, match=r"^ImageDelay: need (latency|period) > 0 s"):
        ImageDelay(MODEL, latency, period)
