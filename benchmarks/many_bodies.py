"""Time of a tick of `KinematicModel` with many moving bodies, by that of a matrix product.

All pairs at every tick, and in turns, side by side: machines differ, ratios less.

    python -m benchmarks.many_bodies --bodies 8
"""

import time
from typing import Annotated

import numpy as np
import typer
from pydrake.common.value import AbstractValue
from pydrake.systems.analysis import Simulator

from benchmarks.matrix_product import NAME, product_time
from crossmodal.maths import se3
from crossmodal.systems.kinematics.joint_graph import KinematicModelConfig
from crossmodal.systems.kinematics.kinematic_model import KinematicModel
from crossmodal.systems.port_values import BodyMotion, BodyMotions, MotionBelief

_COVARIANCE = np.diag(np.repeat([1e-5, 1e-6, 1e-4, 1e-4], 3))
_FIRST_BODY = 2
_SETTLED = 30  # Ticks that are not measured: code is compiled, joints are decided.
_ALL = 100  # More than the pairs of 13 bodies.


def moving_body(body_id: int, t: float, rng: np.random.Generator) -> BodyMotion:
    """A drawer (odd ids) or a door (even ids) that moves at a speed of its own."""
    speed = 1.0 + 0.1 * body_id
    X_WF = np.eye(4)
    X_WF[:3, 3] = [1.0 + 0.3 * (body_id % 3), 0.3 * body_id, 0.5]
    if body_id % 2:
        S_W = np.array([0.0, 0.0, 0.0, 0.02 * speed * t, 0.0, 0.0])
    else:
        axis, point = np.array([0.0, 0.0, 0.1 * speed * t]), X_WF[:3, 3] + [0.0, 0.4, 0.0]
        S_W = np.concatenate([axis, np.cross(point, axis)])
    noise = np.sqrt(np.diag(_COVARIANCE)[:6]) * rng.normal(size=6)
    return BodyMotion(
        body_id=body_id,
        motion=MotionBelief(
            X=se3.exp(S_W) @ X_WF @ se3.exp(noise), V=np.zeros(6), covariance=_COVARIANCE
        ),
        X_WB_reference=X_WF,
        feature_ids=np.zeros(0, np.int64),
        p_BF=np.zeros((0, 3)),
        p_BF_covariance=np.zeros((0, 0)),
    )


class Case:
    """A model that is ticked by hand, with the time that each tick took."""

    def __init__(self, max_pairs: int) -> None:
        self.model = KinematicModel(KinematicModelConfig(max_pairs=max_pairs))
        self.simulator = Simulator(self.model)
        self.context = self.simulator.get_mutable_context()
        self.context.SetTime(-0.5 / 15.0)
        self.update: list[float] = []
        self.read: list[float] = []

    def Tick(self, bodies: BodyMotions) -> None:
        self.model.get_input_port(0).FixValue(self.context, AbstractValue.Make(bodies))
        start = time.perf_counter()
        self.simulator.AdvanceTo(self.context.get_time() + 1.0 / 15.0)
        updated = time.perf_counter()
        for port in ("joints_latest", "bodies_predicted"):
            self.model.GetOutputPort(port).Eval(self.context)
        self.update.append(updated - start)
        self.read.append(time.perf_counter() - updated)


def main(
    bodies: Annotated[int, typer.Option(min=1, max=13, help="Moving bodies.")] = 8,
    ticks: Annotated[int, typer.Option(min=1, help="Ticks that count.")] = 60,
    seed: Annotated[int, typer.Option(help="Of the measurements' noise.")] = 0,
) -> None:
    """Prints the table."""
    rng = np.random.default_rng(seed)
    turns = KinematicModelConfig().max_pairs
    cases = {"all pairs": Case(_ALL), f"{turns} pairs, in turns": Case(turns)}
    product: list[float] = []
    for k in range(_SETTLED + ticks):
        ids = range(_FIRST_BODY, _FIRST_BODY + bodies)
        seen = BodyMotions(bodies=[moving_body(i, k / 15.0, rng) for i in ids])
        for case in cases.values():
            case.Tick(seen)
        product.append(product_time())
    unit = float(np.median(product[_SETTLED:]))
    print(f"{bodies} bodies; a {NAME} takes {1e3 * unit:.1f} ms")
    print("| | update ms | of a product | joints and predictions read, ms |")
    print("|---|---|---|---|")
    for name, case in cases.items():
        update, read = (float(np.median(x[_SETTLED:])) for x in (case.update, case.read))
        print(f"| {name} | {1e3 * update:.1f} | {update / unit:.2f} | {1e3 * read:.1f} |")


if __name__ == "__main__":
    typer.run(main)
