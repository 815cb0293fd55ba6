from diagrams.crossmodal.training.network_training import hand_bending_card


def test_a_card_sets_unseen_errors_beside_those_of_no_bending() -> None:
    error = {"rotation_rms_deg": 1.234, "translation_rms_mm": 2.5}
    facts = {"data": "15 interactions", "split": "pairs", "metric": "rms", "command": "train",
             "hidden": [10, 10, 10], "unseen": error, "no_bending": error, "seen": error,
             "unseen_within_2_sigma": 0.934}  # fmt: skip
    topologies = [{"hidden": (10, 10), "score": 0.25, **error}]
    card = hand_bending_card(facts, topologies)
    assert "| unseen interactions | 1.23 | 2.50 |" in card
    assert "| the same, if there were no bending | 1.23 | 2.50 |" in card
    assert "translation rms [mm]" in card
    assert "93 %" in card
    assert "| 10-10 | 0.25 | 1.23 | 2.50 |" in card
