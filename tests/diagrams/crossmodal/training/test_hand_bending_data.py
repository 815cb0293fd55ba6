"""The station from which the hand's bending is learnt."""

from crossmodal.diagrams.crossmodal.training.hand_bending_data import make_training_station


def test_the_object_of_a_training_station_is_locked() -> None:
    assert make_training_station(seed=0).locked
