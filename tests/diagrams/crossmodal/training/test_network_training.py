from pathlib import Path

import pytest

from crossmodal.diagrams.crossmodal.training import network_training
from crossmodal.diagrams.crossmodal.training.network_training import (
    hand_bending_card,
    train_hand_bending,
)
from crossmodal.diagrams.run.folder.fingerprint import versions

ERROR = {"rotation_rms_deg": 1.234, "translation_rms_mm": 2.5}
FACTS = {"data": "15 interactions", "split": "pairs", "metric": "rms", "command": "train",
         "hidden": [10, 10, 10], "unseen": ERROR, "no_bending": ERROR, "seen": ERROR,
         "unseen_within_2_sigma": 0.934}  # fmt: skip


def test_a_card_sets_unseen_errors_beside_those_of_no_bending() -> None:
    card = hand_bending_card(FACTS)
    assert "| unseen interactions | 1.23 | 2.50 |" in card
    assert "| the same, if there were no bending | 1.23 | 2.50 |" in card
    assert "translation rms [mm]" in card
    assert "93 %" in card


def test_a_card_says_by_which_program_the_networks_were_trained(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(
        network_training, "train", lambda *_, command, **__: (None, FACTS | {"command": command})
    )
    monkeypatch.setattr(network_training, "save_network", lambda path, _: path.touch())
    _, card = train_hand_bending([], seed=3, folder=tmp_path)
    assert (
        f"`crossmodal train hand-bending --seed 3`, crossmodal {versions()['crossmodal']}" in card
    )
    assert f"source {versions()['source']}" in card
    assert (tmp_path / "hand_bending.md").read_text() == card
