import pytest

from crossmodal.diagrams.run.scenario import Disturbances, Interval
from crossmodal.diagrams.stations.lighting import Lighting


@pytest.mark.parametrize(
    ("time", "illumination", "cover"),
    [(0.0, 1, 0), (1.0, 1, 1), (1.9, 1, 1), (2.0, 1, 0), (3.0, 0, 0), (4.0, 1, 0), (99.0, 0, 0)],
)
def test_light_and_cover_follow_their_intervals(
    time: float, illumination: float, cover: float
) -> None:
    system = Lighting(
        Disturbances(
            lights_off=[Interval(start=3.0, end=4.0), Interval(start=50.0)],
            camera_covered=[Interval(start=1.0, end=2.0)],
        )
    )
    context = system.CreateDefaultContext()
    context.SetTime(time)
    assert system.GetOutputPort("illumination").Eval(context) == [illumination]
    assert system.GetOutputPort("cover").Eval(context) == [cover]
