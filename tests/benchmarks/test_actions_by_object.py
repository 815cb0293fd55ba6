"""The table of actions by object, from summaries that are made up."""

import json
from pathlib import Path
from typing import Any

import pytest
import typer

from benchmarks.actions_by_object import main


def action(name: str, kind: str, outcome: str, success: bool, gone: float | None) -> dict[str, Any]:
    return {
        "object": name,
        "kind": kind,
        "outcome": outcome,
        "success": success,
        "displacement": gone,
    }


def test_what_was_begun_is_counted_by_object(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    actions = [
        action("can", "push", "pushed", True, 0.1),
        action("can", "push", "lost", False, 0.03),
        action("can", "push", "lost", False, 0.019),
        action("can", "push", "unreachable", False, 0.0),
        action("can", "push", "pushed", True, None),
        action("oil", "grasp", "placed", True, 0.2),
        action("oil", "grasp", "slipped", False, 0.0),
    ]
    folder = tmp_path / "seed-0000"
    folder.mkdir()
    (folder / "summary.json").write_text(json.dumps({"clutter": {"actions": actions}}))
    main([tmp_path])
    can, oil, everything = capsys.readouterr().out.splitlines()[3:]
    assert can == "| can | 0 | 0 | 4 | 2 | 3 | 2 push lost |"
    assert oil == "| oil | 2 | 1 | 0 | 0 | 0 | 1 grasp slipped |"
    assert everything == "| all | 2 | 1 | 4 | 2 | 3 | 2 push lost, 1 grasp slipped |"


def test_a_folder_without_actions_is_refused(tmp_path: Path) -> None:
    with pytest.raises(typer.BadParameter, match="no seed-"):
        main([tmp_path])
