"""How far the arm meets objects beside where they are seen, before it has met any."""

from dataclasses import replace

import numpy as np
from numpy.testing import assert_allclose

from crossmodal.diagrams.applications import load_scenario
from crossmodal.diagrams.clutter.estimators import make_calibration
from crossmodal.diagrams.clutter.start import true_offset
from crossmodal.diagrams.clutter.station.declutter_control import offset_covariance
from crossmodal.diagrams.run.calibration import CalibrationErrors
from crossmodal.maths import se3

PLACE = np.array([0.5, 0.0, 0.05])
VIEW = se3.looking_at(np.array([0.38, 0.0, 0.74]), PLACE)


def test_it_is_that_of_the_errors_by_lot() -> None:
    _, scenario = load_scenario("declutter", [])
    calibration = make_calibration(scenario)
    offsets = [
        true_offset(replace(scenario, seed=seed), calibration, VIEW, PLACE)[:2]
        for seed in range(400)
    ]
    found = offset_covariance(calibration, VIEW, PLACE)
    assert_allclose(np.sqrt(np.diag(found)), np.std(offsets, axis=0), rtol=0.1)


def test_without_errors_it_is_small_and_still_one() -> None:
    _, scenario = load_scenario("declutter", [])
    believed = replace(scenario.calibration, believed=CalibrationErrors())
    found = offset_covariance(
        make_calibration(replace(scenario, calibration=believed)), VIEW, PLACE
    )
    assert_allclose(found, 2.5e-7 * np.eye(2))
