import numpy as np
import pytest

from crossmodal.systems.sensors.finger_encoders import FingerEncoders, FingerEncodersConfig


def test_fingers_are_measured_in_steps():
    config = FingerEncodersConfig(step=1e-3)
    measured = FingerEncoders(config, 3).measure(np.array([0.0, 0.0174, -0.0004]), 0)
    np.testing.assert_allclose(measured, [0.0, 0.017, 0.0], atol=1e-15)


def test_impossible_values_are_refused_by_name():
    with pytest.raises(ValueError, match="FingerEncoders: step"):
        FingerEncoders(FingerEncodersConfig(step=0.0), 2)
