"""A structured-light RGB-D camera: noise, drop-outs, exposure, on top of Drake's ideal images."""

from dataclasses import dataclass, field
from statistics import NormalDist

import numpy as np
from pydrake.common.value import AbstractValue, Value
from pydrake.systems.framework import Context, LeafSystem, State
from pydrake.systems.sensors import CameraInfo, ImageDepth32F, ImageRgba8U

from crossmodal.maths.arrays import Mask
from crossmodal.maths.validation import check
from crossmodal.systems.sensors.colour_noise import (
    ColourNoiseConfig,
    mean_grey,
    measure_colour,
    next_gain,
    noisy_response,
    response,
)
from crossmodal.systems.sensors.depth_noise import (
    DepthNoiseConfig,
    check_depth_noise,
    correlated_noise,
    measure_depth,
    returns,
)
from crossmodal.systems.sensors.randomness import make_generator, random_bytes
from crossmodal.systems.ticks import NETWORK_PERIOD

_PANE = 1e-3  # By how much a surface lies before another at least, [m].
_NOISE_RATE = 30.0  # How often the noise is another one, [Hz].


@dataclass(kw_only=True)
class CameraNoiseConfig:
    depth: DepthNoiseConfig = field(default_factory=DepthNoiseConfig)
    colour: ColourNoiseConfig = field(default_factory=ColourNoiseConfig)


class CameraNoise(LeafSystem):
    """Turns ideal colour and depth images into what a PrimeSense Carmine-like camera delivers.

    Depth: sigma(z) = 1.2 mm + 1.9 mm/m^2 (z - 0.4 m)^2, correlated over the 9 px patch that the
    camera matches, disparity in steps of 1/8 px, so that depth comes in steps of 2.9 mm/m^2 z^2;
    no return outside the range, where the ray grazes the surface, and to the left of near objects,
    where the projector (to the right of the infrared camera) casts their shadow. Lighting does not
    matter to depth: the camera brings its own. From behind a transparent surface little returns,
    since the pattern passes it twice and is bent and mirrored away; what does, in patches, shows
    what is behind, a little farther away.

    Colour: shot and read noise, gamma, saturation. The auto-exposure follows the mean grey with a
    lag, so that a jump of the lighting gives some frames that are too dark or too bright.

    Images are computed only when read, at whatever rate that is. Their noise depends on the seed
    and the number of the frame, round(30 Hz t), alone: whoever reads whatever how often, a frame's
    noise is the same. Read them at the frames' instants; in between, the noise is the nearest
    frame's. The gain is state, moved on by a periodic event of its own that meters the ideal image
    every `period`; reading does not touch it. The event is an unrestricted one because
    only these are computed before the plant steps: it shares its instant's rendering with the
    filters.

    Input ports:
    - `color_image`: `ImageRgba8U` of an `RgbdSensor`, under normal light.
    - `depth_image`: `ImageDepth32F` of the same sensor, [m]; 0 too near, inf too far.
    - `surface_image`: `ImageDepth32F` of the same camera, [m], in which transparent surfaces are
      solid; may stay unconnected where there are none.
    - `illumination`: (1,) light relative to normal; 0 lights off; 1 if not connected.
    - `cover`: (1,) above 0.5 something covers the camera; 0 if not connected.

    Output ports:
    - `color_measured`: `ImageRgba8U`, alpha 255.
    - `depth_measured`: `ImageDepth32F`, registered to the colour image, [m]; 0 is no return.

    State: gain of the exposure and the mean grey that it seeks (0 until the first metered frame).

    Sources: see `depth_noise` and `colour_noise`.
    """

    def __init__(
        self,
        config: CameraNoiseConfig,
        intrinsics: CameraInfo,
        seed: int,
        depth_scale: float = 1.0,
        first_frame: float = 0.0,
        period: float = NETWORK_PERIOD,
        is_metered: bool = True,
    ) -> None:
        """Declares ports, state and event.

        Args:
            config: Noise and exposure.
            intrinsics: Of the depth image, as the renderer takes them.
            seed: Of the noise.
            depth_scale: Measured depth over true depth.
            first_frame: When the first frame is metered after the start, [s].
            period: Between two metered frames, those that are read, [s].
            is_metered: Whether the exposure follows the light. If it does not, its gain is 1, and
                colour is rendered only where somebody reads it.
        """
        super().__init__()
        if not 0 < depth_scale < np.inf:
            raise ValueError(f"CameraNoise: need depth_scale > 0, got {depth_scale!r}")
        self._depth_scale = depth_scale
        check(config, "CameraNoise")
        check_depth_noise(config.depth)
        self._config, self._period = config, period
        self._seed = seed
        self._shape = (intrinsics.height(), intrinsics.width())
        self._intrinsics = (
            intrinsics.focal_x(),
            intrinsics.focal_y(),
            intrinsics.center_x(),
            intrinsics.center_y(),
        )
        color_model = Value[ImageRgba8U](ImageRgba8U(intrinsics.width(), intrinsics.height()))
        depth_model = Value[ImageDepth32F](ImageDepth32F(intrinsics.width(), intrinsics.height()))
        self._color = self.DeclareAbstractInputPort("color_image", color_model)
        self._depth = self.DeclareAbstractInputPort("depth_image", depth_model)
        self._surface = self.DeclareAbstractInputPort("surface_image", depth_model)
        self._illumination = self.DeclareVectorInputPort("illumination", 1)
        self._cover = self.DeclareVectorInputPort("cover", 1)
        self._exposure = self.DeclareDiscreteState([1.0, config.colour.grey_target])
        self.DeclareAbstractOutputPort("color_measured", color_model.Clone, self._calc_color)
        self.DeclareAbstractOutputPort("depth_measured", depth_model.Clone, self._calc_depth)
        if is_metered:
            self.DeclarePeriodicUnrestrictedUpdateEvent(period, first_frame, self._expose)

    def _calc_color(self, context: Context, output: AbstractValue) -> None:
        gain = context.get_discrete_state_vector().value()[0]
        table = noisy_response(self._config.colour, self._light(context), gain)
        random = random_bytes(self._rng(context, "colour"), 3 * self._shape[0] * self._shape[1])
        ideal = self._color.Eval(context).data
        measure_colour(ideal, table, random, output.get_mutable_value().mutable_data)

    def _calc_depth(self, context: Context, output: AbstractValue) -> None:
        depth = self._config.depth
        measured = output.get_mutable_value().mutable_data[:, :, 0]
        if self._is_covered(context):
            measured[:] = 0.0
            return
        ideal = self._depth.Eval(context).data[:, :, 0]
        valid = returns(
            ideal,
            self._intrinsics,
            (depth.range_min, depth.range_max),
            depth.baseline,
            float(np.cos(depth.grazing_angle)),
        )
        if self._surface.HasValue(context):
            glass = self._surface.Eval(context).data[:, :, 0] <= ideal - _PANE
            valid &= ~glass | self._passes(context)
            ideal = np.where(glass, ideal + np.float32(depth.glass_delay), ideal)
        rng = self._rng(context, "depth")
        measured[:] = measure_depth(
            ideal,
            valid,
            correlated_noise(rng, self._shape, depth.correlation_window),
            depth.depth_step,
            depth.sigma_base,
            depth.sigma_square,
        )
        if self._depth_scale != 1.0:
            measured *= self._depth_scale

    def _passes(self, context: Context) -> Mask:
        """Pixels (H, W) at which what is behind glass returns."""
        depth = self._config.depth
        if not 0.0 < depth.through_glass < 1.0:
            return np.full(self._shape, depth.through_glass > 0.0)
        rng = self._rng(context, "glass")
        patches = correlated_noise(rng, self._shape, depth.correlation_window)
        return np.asarray(patches < NormalDist().inv_cdf(depth.through_glass))

    def _expose(self, context: Context, state: State) -> None:
        colour = self._config.colour
        gain, target = context.get_discrete_state_vector().value()
        table = response(colour, self._light(context), gain)
        grey = mean_grey(self._color.Eval(context).data, table)
        target = target or grey
        gain = next_gain(colour, gain, grey, target, self._period)
        state.get_mutable_discrete_state().get_mutable_value(0)[:] = gain, target

    def _rng(self, context: Context, image: str) -> np.random.Generator:
        frame = round(context.get_time() * _NOISE_RATE)
        return make_generator(self._seed, f"CameraNoise {image}", frame)

    def _is_covered(self, context: Context) -> bool:
        return bool(self._cover.HasValue(context) and self._cover.Eval(context)[0] > 0.5)

    def _light(self, context: Context) -> float:
        if self._is_covered(context):
            return 0.0
        if not self._illumination.HasValue(context):
            return 1.0
        return float(self._illumination.Eval(context)[0])
