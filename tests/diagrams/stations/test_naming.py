from crossmodal.diagrams.stations.naming import own_seed, owner_among, prefixed


def test_the_only_one_needs_no_name() -> None:
    assert prefixed(owner_among("head", ["head"]), "color_measured") == "color_measured"
    assert own_seed(3, owner_among("head", ["head"])) == 3


def test_one_of_several_has_names_and_seed_of_its_own() -> None:
    both = ["left", "right"]
    assert prefixed(owner_among("left", both), "wrench_window") == "left_wrench_window"
    assert len({3, *(own_seed(3, owner_among(name, both)) for name in both)}) == 3
