"""Which of several tasks commands the joints that they share."""

from collections.abc import Sequence

import numpy as np
from pydrake.systems.framework import BasicVector, Context, LeafSystem

from crossmodal.maths.arrays import Array


class CommandSwitch(LeafSystem):
    """Hands out the command of the task that is away from home.

    Each task begins and ends at home, and begins only while the others are there, so that the
    command never jumps. Nothing is kept, and there is no delay.

    Input ports:
    - `<source>_joint_position_commanded`: (n,) of each task, [rad].

    Output ports:
    - `joint_position_commanded`: (n,) of the first task that is away from home, [rad].

    Args:
        sources: Names of the tasks, the first one before the others.
        q_home: Where each begins and ends (n,), [rad].
    """

    def __init__(self, sources: Sequence[str], q_home: Array) -> None:
        super().__init__()
        self._q_home = q_home
        self._sources = [
            self.DeclareVectorInputPort(f"{source}_joint_position_commanded", len(q_home))
            for source in sources
        ]
        self.DeclareVectorOutputPort("joint_position_commanded", len(q_home), self._calc)

    def _calc(self, context: Context, output: BasicVector) -> None:
        commands = (np.asarray(port.Eval(context)) for port in self._sources)
        away = (q for q in commands if not np.array_equal(q, self._q_home))
        output.SetFromVector(next(away, self._q_home))
