"""Moves the hand about a handle that does not give, to learn how the hand bends."""

from dataclasses import dataclass

import numpy as np
from pydrake.common.value import Value
from pydrake.systems.framework import Context, LeafSystem

from controllers.arm.impedance import DesiredMotion
from controllers.interaction.phases import is_held
from maths import se3
from maths.arrays import Array
from maths.validation import require, require_not_negative, require_positive


@dataclass(kw_only=True)
class BendingExcitationConfig:
    rise_time: float = 1.0  # Time in which the motion grows to its full size, [s].
    slowest: float = 0.05  # Lowest frequency, [Hz].
    fastest: float = 0.3  # Highest frequency, [Hz].
    waves: int = 4  # Number of sines per direction.
    rotation: float = 0.06  # Standard deviation about each axis of E, [rad].
    lateral: float = 0.003  # Standard deviation along x and y of E, [m].
    pull: float = 0.006  # Mean and standard deviation of the pull along -z of E, [m].


class SmoothPath:
    """A sum of sines in each of six directions of E, drawn from a seed; zero at the start."""

    def __init__(self, config: BendingExcitationConfig, seed: int) -> None:
        rng = np.random.default_rng((seed, 3))
        size = np.repeat([config.rotation, config.lateral], 3)
        size[5] = config.pull
        shape = (6, config.waves)
        self._config = config
        self._frequency = 2 * np.pi * rng.uniform(config.slowest, config.fastest, shape)
        self._phase = rng.uniform(0.0, 2 * np.pi, shape)
        self._size = size[:, None] * np.sqrt(2.0 / config.waves)

    def __call__(self, elapsed: float) -> Array:
        """The tangent vector (6,) at `elapsed` [s] since the start."""
        waves = self._size * np.sin(self._frequency * elapsed + self._phase)
        xi = waves.sum(axis=1)
        xi[5] -= self._config.pull
        return np.asarray(xi * np.clip(elapsed / self._config.rise_time, 0.0, 1.0))


class BendingExcitation(LeafSystem):
    """Takes the place of the exploration where the object is fixed to the world.

    .. pydrake_system::

        name: BendingExcitation
        input_ports:
        - grasp_motion_desired
        - phase
        output_ports:
        - motion_desired

    - grasp_motion_desired: `DesiredMotion` of the grasp sequence, which holds the grasp's pose.
    - phase: (1,) `Phase`.
    - motion_desired: `DesiredMotion`, a smooth path about the grasp's pose; None before EXPLORE.

    Args:
        config: Size and frequencies of the path.
        start: When exploration starts, [s].
        seed: Of the path.

    Raises:
        ValueError: for impossible values.
    """

    def __init__(self, config: BendingExcitationConfig, start: float, seed: int) -> None:
        super().__init__()
        name = "BendingExcitation"
        require_positive(name, config, {"rise_time": "s", "slowest": "Hz", "waves": ""})
        require(config.slowest <= config.fastest < np.inf, name, config, "fastest", ">= slowest")
        require_not_negative(name, config, {"rotation": "rad", "lateral": "m", "pull": "m"})
        self._path = SmoothPath(config, seed)
        self._start = start
        self._grasp = self.DeclareAbstractInputPort("grasp_motion_desired", Value[object]())
        self._phase = self.DeclareVectorInputPort("phase", 1)
        self.DeclareAbstractOutputPort("motion_desired", lambda: Value[object](), self._calc)

    def _calc(self, context: Context, output: Value) -> None:
        if not is_held(self._phase.Eval(context)[0]):
            output.set_value(None)
            return
        grasp: DesiredMotion = self._grasp.Eval(context)
        offset = se3.exp(self._path(context.get_time() - self._start))
        output.set_value(
            DesiredMotion(X_WE=grasp.X_WE @ offset, V_WE_E=np.zeros(6), A_WE_E=np.zeros(6))
        )
