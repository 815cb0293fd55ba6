"""Maps of twists against the exponential and the adjoint."""

import numpy as np
from numpy.testing import assert_allclose

from crossmodal.controllers.servoing.twists import from_contact, in_world
from crossmodal.maths import se3

RNG = np.random.default_rng(0)


def test_the_contact_moves_as_it_should() -> None:
    V_WC_S, p_SC = RNG.normal(size=6), RNG.normal(size=3)
    V_WS_S = from_contact(V_WC_S, p_SC)
    assert_allclose(V_WS_S[3:] + np.cross(V_WS_S[:3], p_SC), V_WC_S[3:])
    assert_allclose(V_WS_S[:3], V_WC_S[:3])


def test_the_twist_in_the_world_is_the_rate_of_the_pose() -> None:
    X_WS = se3.exp(RNG.normal(size=6))
    V_WS_S, dt = RNG.normal(size=6), 1e-7
    V_WS_W = in_world(X_WS, V_WS_S)
    after = X_WS @ se3.exp(dt * V_WS_S)
    assert_allclose((after[:3, 3] - X_WS[:3, 3]) / dt, V_WS_W[3:], atol=1e-6)
    turn = se3.so3_log(after[:3, :3] @ X_WS[:3, :3].T) / dt
    assert_allclose(turn, V_WS_W[:3], atol=1e-6)


def test_the_adjoint_gives_the_same_motion_at_the_worlds_origin() -> None:
    X_WS = se3.exp(RNG.normal(size=6))
    V_WS_S = RNG.normal(size=6)
    V_WS_W = in_world(X_WS, V_WS_S)
    at_origin = se3.adjoint(X_WS) @ V_WS_S
    assert_allclose(at_origin[:3], V_WS_W[:3])
    assert_allclose(at_origin[3:], V_WS_W[3:] + np.cross(X_WS[:3, 3], V_WS_W[:3]))
