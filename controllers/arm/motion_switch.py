"""Which of several motion sources commands the arm."""

from collections.abc import Sequence

from pydrake.common.value import Value
from pydrake.systems.framework import Context, InputPort, LeafSystem

from crossmodal.controllers.arm.impedance import NO_GAINS, NO_MOTION, DesiredMotion, ImpedanceGains


class MotionSwitch(LeafSystem):
    """Hands out the motion and the gains of the last source that has some.

    A source that does not command the arm says `NO_MOTION`. Motion and gains are chosen apart: a
    source of motions alone leaves the gains to the sources before it.

    The switch keeps nothing and has no delay. A source that has to go on from the motion commanded
    before it reads `motion_commanded` in its update; that closes no algebraic loop as long as its
    own outputs depend on its state alone. With sources A and B that update every T, B taking over:

        t_k        unrestricted updates: both see the state before t_k. B decides to begin, reads
                   the motion that A has commanded since t_(k-1), and stores its first one.
        t_k +      discrete updates, the impedance controller's among them, get B's first motion.
        t_k + T    B goes on from its own motion.

    When B stores `NO_MOTION` again, A commands from that same instant on.

    Input ports:
    - `<source>_motion_desired`: `DesiredMotion`, or `NO_MOTION`; may stay unconnected.
    - `<source>_gains_desired`: `ImpedanceGains`, or `NO_GAINS`; may stay unconnected.

    Output ports:
    - `motion_commanded`, `gains_commanded`: of the last source that has some; `NO_MOTION` and
      `NO_GAINS` without any.

    Args:
        sources: Their names, each once, the one that yields to all others first.
    """

    def __init__(self, sources: Sequence[str]) -> None:
        super().__init__()
        nothing: DesiredMotion | ImpedanceGains
        for quantity, nothing in (("motion", NO_MOTION), ("gains", NO_GAINS)):
            inputs = [
                self.DeclareAbstractInputPort(
                    f"{source}_{quantity}_desired", Value[object](nothing)
                )
                for source in sources
            ]
            self.DeclareAbstractOutputPort(
                f"{quantity}_commanded",
                lambda nothing=nothing: Value[object](nothing),
                lambda context, output, inputs=inputs, nothing=nothing: output.set_value(
                    _last(context, inputs, nothing)
                ),
                {port.ticket() for port in inputs},
            )


def _last(
    context: Context, inputs: Sequence[InputPort], nothing: DesiredMotion | ImpedanceGains
) -> DesiredMotion | ImpedanceGains:
    """The value of the last input that has one."""
    connected = (port.Eval(context) for port in reversed(inputs) if port.HasValue(context))
    return next((value for value in connected if value.exists), nothing)
