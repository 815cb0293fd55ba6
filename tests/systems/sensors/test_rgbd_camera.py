import numpy as np
import pytest
from pydrake.common.value import Value
from pydrake.common.yaml import yaml_load_typed
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder, LeafSystem
from pydrake.systems.sensors import CameraInfo, ImageDepth32F, ImageRgba8U

from crossmodal.systems.sensors.rgbd_camera import CameraNoise, CameraNoiseConfig

WIDTH, HEIGHT = 160, 120
INTRINSICS = CameraInfo(WIDTH, HEIGHT, 144.0, 144.0, 79.5, 59.5)
TICK = 1.0 / 15.0
GREY = 110


class IdealCamera(LeafSystem):
    """A wall 1 m away, drawn when read; counts its drawings. The light jumps at `dark_from`."""

    def __init__(self, dark_from=np.inf, light=0.1):
        super().__init__()
        self.drawings = 0
        self._dark_from, self._light = dark_from, light
        color = Value[ImageRgba8U](ImageRgba8U(WIDTH, HEIGHT))
        depth = Value[ImageDepth32F](ImageDepth32F(WIDTH, HEIGHT))
        self.DeclareAbstractOutputPort("color_image", color.Clone, self._color)
        self.DeclareAbstractOutputPort("depth_image", depth.Clone, self._depth)
        self.DeclareVectorOutputPort("illumination", 1, self._illumination)

    def _color(self, context, output):
        self.drawings += 1
        output.get_mutable_value().mutable_data[:] = GREY

    def _depth(self, context, output):
        output.get_mutable_value().mutable_data[:] = 1.0

    def _illumination(self, context, output):
        dark = context.get_time() > self._dark_from - 1e-9
        output.set_value([self._light if dark else 1.0])


class Reader(LeafSystem):
    """Reads both images every `period`, in an unrestricted update or when published."""

    def __init__(self, period, published=False):
        super().__init__()
        self.colors, self.depths, self.times = [], [], []
        self._color = self.DeclareAbstractInputPort("color", Value[ImageRgba8U]())
        self._depth = self.DeclareAbstractInputPort("depth", Value[ImageDepth32F]())
        if published:
            self.DeclarePeriodicPublishEvent(period, 0.0, self._read)
        else:
            self.DeclarePeriodicUnrestrictedUpdateEvent(period, 0.0, self._read)

    def _read(self, context, _state=None):
        self.times.append(context.get_time())
        self.colors.append(self._color.Eval(context).data.copy())
        self.depths.append(self._depth.Eval(context).data.copy())


def simulate(duration, seed=0, reader_periods=(TICK,), published=False, is_metered=True, **light):
    builder = DiagramBuilder()
    ideal = builder.AddSystem(IdealCamera(**light))
    camera = builder.AddSystem(
        CameraNoise(CameraNoiseConfig(), INTRINSICS, seed, is_metered=is_metered)
    )
    for port in ("color_image", "depth_image", "illumination"):
        builder.Connect(ideal.GetOutputPort(port), camera.GetInputPort(port))
    readers = [builder.AddSystem(Reader(period)) for period in reader_periods]
    if published:
        readers.append(builder.AddSystem(Reader(TICK, published=True)))
    for reader in readers:
        builder.Connect(camera.GetOutputPort("color_measured"), reader.GetInputPort("color"))
        builder.Connect(camera.GetOutputPort("depth_measured"), reader.GetInputPort("depth"))
    Simulator(builder.Build()).AdvanceTo(duration)
    return ideal, readers


def fixed_camera(seed=0, config=None, **inputs):
    camera = CameraNoise(config or CameraNoiseConfig(), INTRINSICS, seed)
    context = camera.CreateDefaultContext()
    color, depth = ImageRgba8U(WIDTH, HEIGHT), ImageDepth32F(WIDTH, HEIGHT)
    color.mutable_data[:] = GREY
    depth.mutable_data[:] = 1.0
    camera.GetInputPort("color_image").FixValue(context, color)
    camera.GetInputPort("depth_image").FixValue(context, depth)
    for port, value in inputs.items():
        camera.GetInputPort(port).FixValue(context, [value])
    return camera, context


def images(camera, context, time=0.0):
    context.SetTime(time)
    color = camera.GetOutputPort("color_measured").Eval(context).data.copy()
    depth = camera.GetOutputPort("depth_measured").Eval(context).data.copy()
    return color, depth


def test_the_same_seed_gives_the_same_images_and_another_seed_others():
    first, again, other = (images(*fixed_camera(seed)) for seed in (5, 5, 6))
    for image, same, different in zip(first, again, other, strict=True):
        np.testing.assert_array_equal(image, same)
        assert np.mean(image != different) > 0.2


def test_each_frame_has_its_own_noise_whatever_was_read_before():
    camera, context = fixed_camera()
    first, second = images(camera, context, 0.0), images(camera, context, 1.0 / 30.0)
    for image, different in zip(first, second, strict=True):
        assert np.mean(image != different) > 0.2
    for image, same in zip(first, images(camera, context, 0.0), strict=True):
        np.testing.assert_array_equal(image, same)


def test_depth_and_colour_are_read_where_the_ideal_camera_sees_something():
    color, depth = images(*fixed_camera())
    np.testing.assert_allclose(color[:, :, :3].mean(), GREY, atol=1.5)
    np.testing.assert_allclose(depth[1:-1, 1:-1].mean(), 1.0, atol=2e-3)


def test_a_covered_camera_sees_black_and_no_depth():
    color, depth = images(*fixed_camera(cover=1.0))
    assert color[:, :, :3].mean() < 15.0
    assert not depth.any()


def test_nothing_returns_from_behind_a_transparent_surface():
    camera, context = fixed_camera()
    surface = ImageDepth32F(WIDTH, HEIGHT)
    surface.mutable_data[:] = 1.0
    surface.mutable_data[:, : WIDTH // 2] = 0.9
    camera.GetInputPort("surface_image").FixValue(context, surface)
    _, depth = images(camera, context)
    assert not depth[:, : WIDTH // 2].any()
    assert depth[1:-1, WIDTH // 2 : -1].all()


def test_some_of_what_is_behind_glass_returns_a_little_farther_away():
    config = CameraNoiseConfig()
    config.depth.through_glass = 0.3
    camera, context = fixed_camera(config=config)
    surface = ImageDepth32F(WIDTH, HEIGHT)
    surface.mutable_data[:] = 0.9
    camera.GetInputPort("surface_image").FixValue(context, surface)
    _, depth = images(camera, context)
    through = depth[depth > 0.0]
    assert 0.1 < len(through) / depth.size < 0.5
    assert abs(np.median(through) - 1.0 - config.depth.glass_delay) < 3e-3


def test_depth_does_not_need_light():
    with_light, without = images(*fixed_camera()), images(*fixed_camera(illumination=0.0))
    np.testing.assert_array_equal(with_light[1], without[1])
    assert without[0][:, :, :3].mean() < 15.0


def test_readers_and_exposure_share_one_drawing_per_instant():
    ideal, readers = simulate(0.99, reader_periods=(TICK, TICK, TICK), published=True)
    assert ideal.drawings == 15
    assert [len(reader.times) for reader in readers] == [15, 15, 15, 15]


def test_without_a_meter_colour_is_drawn_for_its_readers_only():
    ideal, _ = simulate(0.99, reader_periods=(), is_metered=False)
    assert ideal.drawings == 0
    ideal, (reader,) = simulate(0.99, reader_periods=(0.5,), is_metered=False, dark_from=0.1)
    assert ideal.drawings == 2
    assert reader.colors[1][:, :, :3].mean() < 0.65 * GREY


def test_constant_light_leaves_the_exposure_alone():
    _, (reader,) = simulate(1.0)
    means = [color[:, :, :3].mean() for color in reader.colors]
    np.testing.assert_allclose(means, GREY, atol=1.5)


def test_a_jump_of_the_light_gives_dark_frames_then_recovers_then_over_exposes():
    _, (reader,) = simulate(2.0, dark_from=0.5, light=0.3)
    means = np.array([color[:, :, :3].mean() for color in reader.colors])
    dark = np.array(reader.times) > 0.5
    assert means[dark][0] < 0.65 * GREY
    assert (means[dark][:3] < 0.85 * GREY).all()
    np.testing.assert_allclose(means[-5:], GREY, rtol=0.06)

    _, (reader,) = simulate(2.0, dark_from=0.5, light=3.0)
    means = np.array([color[:, :, :3].mean() for color in reader.colors])
    assert means[dark][0] > 1.5 * GREY
    np.testing.assert_allclose(means[-5:], GREY, rtol=0.06)


def test_who_else_reads_how_often_changes_no_image():
    _, (alone,) = simulate(1.0, dark_from=0.5)
    _, (accompanied, _) = simulate(1.0, dark_from=0.5, reader_periods=(TICK, 1.0 / 30.0))
    for image, same in zip(alone.colors, accompanied.colors, strict=True):
        np.testing.assert_array_equal(image, same)
    for image, same in zip(alone.depths, accompanied.depths, strict=True):
        np.testing.assert_array_equal(image, same)


def test_configuration_loads_from_yaml_and_refuses_what_is_impossible():
    config = yaml_load_typed(
        schema=CameraNoiseConfig, data="depth: {range_max: 2.5}\ncolour: {read_noise: 4.0}"
    )
    assert (config.depth.range_max, config.colour.read_noise) == (2.5, 4.0)
    config.depth.range_min = 0.0
    with pytest.raises(ValueError, match=r"CameraNoise: depth.range_min = 0\.0 m, need >= 0.001"):
        CameraNoise(config, INTRINSICS, 0)
