"""Times the tactile and visual servoing of the flap, per simulated second.

    python -m benchmarks.servoing --seconds 5

The controllers alone, in a contact of 0.5 N, with the joints at rest; beside it the time of a
matrix product, for machines differ. Tracking and estimation are timed within an episode:
`python -m benchmarks.episode --scenario flap`.
"""

from time import perf_counter
from typing import Annotated

import numpy as np
import typer
from pydrake.math import RigidTransform
from pydrake.systems.analysis import Simulator

from benchmarks.matrix_product import NAME, product_time
from crossmodal.diagrams.flap.flip_control import FlipControlConfig, make_flip_control
from crossmodal.plants.robots.arm_with_hand import make_arm_with_load
from crossmodal.plants.robots.lwr import LWR_WITH_FINGERTIP
from crossmodal.systems.tactile.taxel_layout import fingertip_layout

_Q = np.array([-0.22, -0.63, -0.39, 1.6, 1.4, 1.01, -0.83])
_PRESSED = np.where(np.isin(np.arange(12), [0, 3, 8, 11]), 0.13, 0.0)


def main(
    seconds: Annotated[int, typer.Option(min=1, help="Simulated seconds.")] = 5,
) -> None:
    """Prints the table."""
    model = make_arm_with_load(LWR_WITH_FINGERTIP, RigidTransform())
    control = make_flip_control(FlipControlConfig(), model, fingertip_layout(), _Q)
    simulator = Simulator(control)
    context = simulator.get_mutable_context()
    control.GetInputPort("taxel_measured").FixValue(context, _PRESSED)
    state = np.concatenate([_Q, np.zeros(7)])
    control.GetInputPort("joint_state_measured").FixValue(context, state)
    simulator.Initialize()
    times, product = [], []
    for second in range(1, 1 + seconds):
        start = perf_counter()
        simulator.AdvanceTo(float(second))
        times.append(perf_counter() - start)
        product.append(product_time())
    wall, unit = float(np.median(times)), float(np.median(product))
    print(f"| servoing | wall per simulated second [s] | of a {NAME} |")
    print("|---|---|---|")
    print(f"| touch, vision, sequence, joints | {wall:.3f} | {wall / unit:.1f} |")


if __name__ == "__main__":
    typer.run(main)
