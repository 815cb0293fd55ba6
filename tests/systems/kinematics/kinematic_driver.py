"""Bodies that slide, and a driver that ticks a `KinematicModel` by hand."""

import numpy as np
from pydrake.common.value import AbstractValue
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import Context

from crossmodal.maths import se3
from crossmodal.systems.kinematics.kinematic_model import KinematicModel
from crossmodal.systems.port_values import (
    HELD_BODY,
    BodyMotion,
    BodyMotions,
    HeldBody,
    JointBeliefs,
    MotionBelief,
    StreamHealth,
)

REFERENCE_ERROR = np.diag(np.repeat([2.5e-3, 3.6e-5], 3))
COVARIANCE = np.diag(np.repeat([1e-5, 1e-6, 1e-4, 1e-4], 3))


def sliding_body(body_id: int, x: float, V: float = 0.0, seed: int | None = None) -> BodyMotion:
    """A body that has slid along W's x axis by `x` [m], at `V` [m/s]."""
    reference = np.eye(4)
    reference[:3, 3] = [1.0, 0.1 * body_id, 0.5]
    X = reference.copy()
    X[0, 3] += x
    if seed is not None:
        noise = np.random.default_rng(seed).normal(size=6)
        X = X @ se3.exp(np.sqrt(np.diag(COVARIANCE)[:6]) * noise)
    body = BodyMotion(
        body_id=body_id,
        motion=MotionBelief(X=X, V=np.array([0.0, 0.0, 0.0, V, 0.0, 0.0]), covariance=COVARIANCE),
        X_WB_reference=reference,
        feature_ids=np.zeros(0, np.int64),
        p_BF=np.zeros((0, 3)),
        p_BF_covariance=np.zeros((0, 0)),
    )
    if body_id != HELD_BODY:
        return body
    return HeldBody(**vars(body), seen=None, seen_offset_covariance=np.zeros((6, 6)))


class Driver:
    """Ticks a model by hand."""

    def __init__(self, model: KinematicModel) -> None:
        self.model = model
        self.simulator = Simulator(model)
        self.context: Context = self.simulator.get_mutable_context()
        self.context.SetTime(-0.5 / 15.0)

    def set(self, *bodies: BodyMotion, port: int = 0) -> None:
        self.model.get_input_port(port).FixValue(
            self.context, AbstractValue.Make(BodyMotions(bodies=list(bodies)))
        )

    def tick(self) -> None:
        """From between two ticks to between the next two."""
        self.simulator.AdvanceTo(self.context.get_time() + 1.0 / 15.0)

    def joints(self, role: str = "latest") -> JointBeliefs:
        joints: JointBeliefs = self.model.GetOutputPort(f"joints_{role}").Eval(self.context)
        return joints

    def health(self) -> StreamHealth:
        health: StreamHealth = self.model.GetOutputPort("health_latest").Eval(self.context)
        return health

    def pairs(self) -> list[tuple[int, int]]:
        return [(j.parent_id, j.child_id) for j in self.joints().joints]


def slide(driver: Driver, body_id: int, ticks: int = 45) -> None:
    for k in range(1, ticks + 1):
        driver.set(sliding_body(body_id, 0.02 * k / 15.0, 0.02, seed=k))
        driver.tick()
