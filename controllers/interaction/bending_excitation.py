"""Moves the hand about a handle that does not give, to learn how the hand bends."""

from dataclasses import dataclass

import numpy as np
from pydrake.common.value import Value
from pydrake.systems.framework import Context, LeafSystem

from crossmodal.controllers.arm.impedance import NO_MOTION, DesiredMotion
from crossmodal.controllers.interaction.phases import is_held
from crossmodal.maths import se3
from crossmodal.maths.arrays import Array
from crossmodal.maths.validation import check, number, require


@dataclass(kw_only=True)
class BendingExcitationConfig:
    # Time in which the motion grows to its full size.
    rise_time: float = number(1.0, at_least=1e-3, at_most=3600.0, unit="s")
    slowest: float = number(0.05, at_least=1e-6, at_most=100.0, unit="Hz")  # Lowest frequency.
    fastest: float = number(0.3, at_least=1e-6, at_most=100.0, unit="Hz")  # Highest frequency.
    waves: int = number(4, at_least=1, at_most=1000)  # Number of sines per direction.
    # Standard deviation about each axis of E.
    rotation: float = number(0.06, at_least=0.0, at_most=3.2, unit="rad")
    # Standard deviation along x and y of E.
    lateral: float = number(0.003, at_least=0.0, at_most=10.0, unit="m")
    # Mean and standard deviation of the pull along -z of E.
    pull: float = number(0.006, at_least=0.0, at_most=10.0, unit="m")


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

    Input ports:
    - `grasp_motion_desired`: `DesiredMotion` of the grasp sequence, which holds the grasp's pose.
    - `phase`: (1,) `Phase`.

    Output ports:
    - `motion_desired`: `DesiredMotion`, a smooth path about the grasp's pose;
      `NO_MOTION` before EXPLORE.

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
        check(config, name)
        require(config.slowest <= config.fastest, name, config, "fastest", ">= slowest")
        self._path = SmoothPath(config, seed)
        self._start = start
        self._grasp = self.DeclareAbstractInputPort(
            "grasp_motion_desired", Value[object](NO_MOTION)
        )
        self._phase = self.DeclareVectorInputPort("phase", 1)
        self.DeclareAbstractOutputPort(
            "motion_desired", lambda: Value[object](NO_MOTION), self._calc
        )

    def _calc(self, context: Context, output: Value) -> None:
        if not is_held(self._phase.Eval(context)[0]):
            output.set_value(NO_MOTION)
            return
        grasp: DesiredMotion = self._grasp.Eval(context)
        offset = se3.exp(self._path(context.get_time() - self._start))
        output.set_value(
            DesiredMotion(X_WE=grasp.X_WE @ offset, V_WE_E=np.zeros(6), A_WE_E=np.zeros(6))
        )
