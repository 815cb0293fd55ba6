"""What happens in some intervals only."""

import pytest

from crossmodal.diagrams.run.scenario import Interval, LightsOff
from crossmodal.diagrams.stations.occurrence import Occurrence


@pytest.mark.parametrize(
    ("time", "value"), [(0.0, 0.0), (1.0, 1.0), (1.99, 1.0), (2.0, 0.0), (6.0, 1.0)]
)
def test_it_occurs_from_each_start_to_before_each_end(time: float, value: float) -> None:
    system = Occurrence([Interval(start=1.0, end=2.0), Interval(start=5.0)])
    context = system.CreateDefaultContext()
    context.SetTime(time)
    assert system.get_output_port().Eval(context)[0] == value


@pytest.mark.parametrize(("time", "value"), [(0.0, 1.0), (1.0, 0.5), (2.0, 0.0), (3.0, 1.0)])
def test_of_values_at_once_the_least_counts(time: float, value: float) -> None:
    spans = [LightsOff(start=1.0, end=3.0, remaining=0.5), LightsOff(start=2.0, end=3.0)]
    system = Occurrence(spans, during=lambda span: span.remaining, otherwise=1.0)
    context = system.CreateDefaultContext()
    context.SetTime(time)
    assert system.get_output_port().Eval(context)[0] == value
