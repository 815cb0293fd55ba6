import pytest

from diagrams.stations.lighting import Light, Lighting


@pytest.mark.parametrize(
    ("time", "illumination", "cover"),
    [(0.0, 1, 0), (1.0, 1, 1), (1.9, 1, 1), (2.0, 1, 0), (3.0, 0, 0), (4.0, 1, 0), (99.0, 0, 0)],
)
def test_light_and_cover_follow_their_intervals(
    time: float, illumination: float, cover: float
) -> None:
    light = Light(lights_off=[(3.0, 4.0), (50.0, float("inf"))], covered=[(1.0, 2.0)])
    system = Lighting(light)
    context = system.CreateDefaultContext()
    context.SetTime(time)
    assert system.GetOutputPort("illumination").Eval(context) == [illumination]
    assert system.GetOutputPort("cover").Eval(context) == [cover]
