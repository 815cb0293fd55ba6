"""Drives follow what the encoders say of the joints."""

import numpy as np

from crossmodal.diagrams.stations.drives import Drives
from crossmodal.systems.sensors.joint_encoders import JointEncoders, joint_side_encoders

_Q = np.array([0.3, -1.2, 0.8])


def test_an_arm_that_is_commanded_where_it_is_read_stays_where_it_is() -> None:
    encoders = JointEncoders(joint_side_encoders(), np.eye(6)[:, :3], seed=4)
    read = encoders.as_read(_Q)
    assert np.abs(read - _Q).max() > 3e-4
    drives = Drives(encoders, 3)
    context = drives.CreateDefaultContext()
    drives.get_input_port().FixValue(context, read)
    desired = drives.get_output_port().Eval(context)
    # As exactly as the encoders' noise allows.
    np.testing.assert_allclose(desired[:3], _Q, atol=1e-4)
    np.testing.assert_array_equal(desired[3:], 0.0)
