"""What happens in some intervals only."""

import pytest

from crossmodal.diagrams.run.scenario import Interval
from crossmodal.diagrams.stations.occurrence import Occurrence


@pytest.mark.parametrize(
    ("time", "value"), [(0.0, 0.0), (1.0, 1.0), (1.99, 1.0), (2.0, 0.0), (6.0, 1.0)]
)
def test_it_occurs_from_each_start_to_before_each_end(time: float, value: float) -> None:
    system = Occurrence([Interval(start=1.0, end=2.0), Interval(start=5.0)])
    context = system.CreateDefaultContext()
    context.SetTime(time)
    assert system.get_output_port().Eval(context)[0] == value


@pytest.mark.parametrize(("time", "value"), [(0.0, 1.0), (1.0, 0.0), (2.0, 1.0)])
def test_what_is_off_meanwhile_is_on_otherwise(time: float, value: float) -> None:
    system = Occurrence([Interval(start=1.0, end=2.0)], during=0.0)
    context = system.CreateDefaultContext()
    context.SetTime(time)
    assert system.get_output_port().Eval(context)[0] == value
