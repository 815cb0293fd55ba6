"""The station from which the hand's bending is learnt."""

from crossmodal.diagrams.crossmodal.training.hand_bending_data import make_training_station


def test_the_object_of_a_training_station_is_locked() -> None:
    station = make_training_station(seed=0)
    context = station.diagram.CreateDefaultContext()
    station.initialise(context)
    assert station.joint.is_locked(station.scene.plant.GetMyContextFromRoot(context))
