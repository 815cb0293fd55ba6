"""How often each thing was grasped and pushed out of the way, in one evaluation or in several.

crossmodal evaluate declutter --seeds 0:20
python -m benchmarks.actions_by_object runs/evaluate/declutter

Actions that the arm could not even begin are left out. A push did what it should if the object was
moved and felt until about the push's end; it has moved its object even if it was lost on the way,
once that has gone two centimetres, or is not seen any more.
"""

import json
from collections import Counter, defaultdict
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer

from crossmodal.diagrams.clutter.results.declutter_results import begun

MOVED = 0.02  # [m].
HEAD = ("object", "grasps", "did", "pushes", "did", "moved it", "how the others ended")


def row(name: str, actions: list[Mapping[str, Any]]) -> str:
    """Of the table, of all actions on one thing."""
    by_kind = {kind: [a for a in actions if a["kind"] == kind] for kind in ("grasp", "push")}
    cells = [name]
    for group in by_kind.values():
        cells += [str(len(group)), str(sum(a["success"] for a in group))]
    gone = [np.inf if a["displacement"] is None else a["displacement"] for a in by_kind["push"]]
    cells.append(str(sum(length >= MOVED for length in gone)))
    failures = Counter(f"{a['kind']} {a['outcome']}" for a in actions if not a["success"])
    cells.append(", ".join(f"{count} {how}" for how, count in failures.most_common()) or "-")
    return "| " + " | ".join(cells) + " |"


def main(
    folders: Annotated[list[Path], typer.Argument(help="Of evaluations, counted together.")],
) -> None:
    """Prints the table, the things with most actions first."""
    by_object = defaultdict[str, list[Mapping[str, Any]]](list)
    files = [file for folder in folders for file in sorted(folder.glob("seed-*/summary.json"))]
    for file in files:
        for action in begun(json.loads(file.read_text())):
            by_object[action["object"]].append(action)
    if not by_object:
        named = ", ".join(map(str, folders))
        raise typer.BadParameter(f"no seed-*/summary.json with actions in {named}")
    print(f"{len(files)} episodes")
    print("| " + " | ".join(HEAD) + " |")
    print("|" + "---|" * len(HEAD))
    for name, actions in sorted(by_object.items(), key=lambda item: -len(item[1])):
        print(row(name, actions))
    print(row("all", [action for actions in by_object.values() for action in actions]))


if __name__ == "__main__":
    typer.run(main)
