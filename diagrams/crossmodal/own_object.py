"""Objects that do not come with the program: on the command line, and in a run's folder."""

import warnings
from collections.abc import Collection, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from crossmodal.diagrams.crossmodal.objects.object_import import (
    ABOVE_FLOOR,
    FLOOR_SCENE,
    ObjectWarning,
    PlaceWarning,
    copied_files,
    imported,
)
from crossmodal.diagrams.crossmodal.objects.object_model import ObjectModel, read_object_model
from crossmodal.diagrams.crossmodal.scenario import Scenario, object_model_file
from crossmodal.diagrams.run.own_object import OwnObject
from crossmodal.diagrams.run.yaml_input.schema import ScenarioError
from crossmodal.plants.object_import import MODEL_FILE
from crossmodal.plants.scene import has_model

# What a hand does with a handle that nobody has tried before: it pulls with 16 N at most, which is
# about what it holds, goes on as the handle has gone, and tries again in other ways.
_ANOTHER_TRY = {
    "control.sequence.other_grasps": True,
    "control.sequence.stuck_time": 5.0,
    "control.exploration.lead": 0.04,
    "control.pull_direction.along": "path",
}
MODEL_FOLDER = "model"  # Of a run, for the copies of imported models.


def own_object_assignments(
    scenario: Scenario, source: str, own: OwnObject, assignments: Sequence[str] = ()
) -> list[str]:
    """The assignments `key.path=value` that put an own object in place of a scenario's.

    Friction becomes what the scenario's is at the hand, and the opening asked for what the joint's
    limits allow.

    Args:
        scenario: The one whose object is replaced, with the user's assignments.
        source: Its name or file.
        assignments: The user's.
    """
    base, thing = scenario, scenario.object
    given = {assignment.partition("=")[0].strip() for assignment in assignments}
    name = scenario.task.object or next(iter(scenario.objects))
    at_base = read_object_model(
        object_model_file(thing), joint=thing.joint, frame=thing.handle_frame, source=source
    )
    made = imported(
        own.model,
        joint=own.joint,
        frame=own.grasp_frame,
        free=thing.free,
        scale=own.scale,
        source="--object",
    )
    facts = read_object_model(
        made.model, joint=made.joint, frame=made.grasp_frame, source="--object"
    )
    pull = _numbers("--pull-direction", own.pull_direction or "1,0,0", 3)
    pulling = thing.friction / (at_base.lever if at_base.lever else 1.0)
    values: dict[str, object] = {
        "model": str(made.model.resolve()),
        "joint": made.joint,
        "handle_frame": made.grasp_frame,
        "pull_direction": pull,
        "initial_position": _initial_position(thing.initial_position, at_base, facts),
        "friction": float(pulling * facts.lever if facts.lever else pulling),
        "variation.textures": [],
    }
    others = list[str]()
    if own.pose:
        pose = _numbers("--object-pose", own.pose, 6)
        angles = np.rad2deg(pose[3:]).tolist()
        values |= dict(zip(("roll", "pitch", "yaw"), angles, strict=True))
        values |= {"place_handle": False, "position": pose[:3]}
        values |= {"variation.position": [0.0, 0.0, 0.0], "variation.yaw": 0.0}
    else:
        more, others = _stand(base, at_base, facts, made.model, given)
        values |= more
    if not thing.free:
        others += _further_tries(base, given)
    lines = [f"objects.{name}.{key}={value}" for key, value in values.items()]
    return lines + others + _task_assignments(base, at_base, facts, made.joint, given)


def _stand(
    base: Scenario,
    at_base: ObjectModel,
    facts: ObjectModel,
    model: Path,
    given: Collection[str],
) -> tuple[dict[str, object], list[str]]:
    """Where an own object stands, as keys of the object, and what else of the scenario changes.

    It is on the table or floor of a scene that the user has given. One that is free stands at the
    place of the scenario's own, on the same ground, or it would fall.
    """
    thing = base.object
    X_WH = thing.pose() @ at_base.X_OH
    p_WH, x_axis = X_WH.translation(), X_WH.rotation().col(0)
    ground = ABOVE_FLOOR
    if has_model(base.plant.scene, "table"):
        ground = float(p_WH[2] + at_base.bottom - at_base.X_OH.translation()[2])
    yaw = float(np.rad2deg(np.arctan2(x_axis[1], x_axis[0])))
    values: dict[str, object] = {"place_handle": True, "yaw": yaw}
    if thing.free:
        height = float(facts.X_OH.translation()[2] - facts.bottom)
        sway = [*thing.variation.position[:2].tolist(), 0.0]
        position = [*p_WH[:2].tolist(), ground + height]
        return values | {"variation.position": sway, "position": position}, []
    grounds = {base.plant.scene: ground}
    if "plant.scene" not in given:
        grounds[FLOOR_SCENE] = ABOVE_FLOOR
    from crossmodal.diagrams.crossmodal.objects.placement import find_place  # Slow: trimesh.

    try:
        place = find_place(
            facts, model, X_WH, grounds, base.control, _wanted(base, at_base, facts, given),
            sway=float(thing.variation.position[2]),
        )  # fmt: skip
    except ValueError as error:
        raise ScenarioError(f"--object: {error}; --object-pose puts it elsewhere") from None
    if place.reason:
        warnings.warn(f"it stands {place}: {place.reason}", PlaceWarning, stacklevel=4)
    moved = place.X_WH.translation() - p_WH
    others = [f"plant.scene={place.scene}"] if place.scene != base.plant.scene else []
    if "control.posture" not in given:
        others.append(f"control.posture={place.posture.tolist()}")
    if np.any(moved):
        others += [
            f"cameras.{camera}.looking_at={(config.looking_at + moved).tolist()}"
            for camera, config in base.cameras.items()
            if not any(key.startswith("cameras.") for key in given)
        ]
    return values | {"position": place.X_WH.translation().tolist()}, others


def _further_tries(base: Scenario, given: Collection[str]) -> list[str]:
    """How an object that stands fast is pulled and held again, and the time for that."""
    sequence = base.control.sequence
    one_try = sequence.release_time + sequence.approach_time + sequence.close_time
    values: dict[str, object] = {"duration": base.duration + sequence.retries * one_try}
    if not base.task.return_to_start:
        values |= _ANOTHER_TRY
    return [f"{key}={value}" for key, value in values.items() if key not in given]


def _to_joint(at_base: ObjectModel, facts: ObjectModel) -> float:
    """From the unit of a scenario's own joint to that of another object's joint, at the handle."""
    if at_base.unit == facts.unit:
        return 1.0
    return 1.0 / facts.lever if facts.lever else at_base.lever or 1.0


def _initial_position(initial_position: float, at_base: ObjectModel, facts: ObjectModel) -> float:
    """Where the joint starts: as far from 0 as the scenario's own, towards the farther limit."""
    way = 1.0 if facts.upper >= -facts.lower else -1.0
    return float(
        np.clip(way * abs(initial_position) * _to_joint(at_base, facts), facts.lower, facts.upper)
    )


def _wanted(
    base: Scenario, at_base: ObjectModel, facts: ObjectModel, given: Collection[str]
) -> float:
    """How far the task asks the joint to go, as far as its limits allow, [m or rad]."""
    key = "opening" if base.task.goal is None else "goal"
    wanted = getattr(base.task, key) * (
        1.0 if f"task.{key}" in given else _to_joint(at_base, facts)
    )
    return float(min(wanted, _most(facts)))


def _most(facts: ObjectModel) -> float:
    """The most that a task asks of a joint, short of its limit, [m or rad]."""
    return 0.9 * max(abs(facts.lower), abs(facts.upper))


def _task_assignments(
    base: Scenario, at_base: ObjectModel, facts: ObjectModel, joint: str, given: Collection[str]
) -> list[str]:
    """The task in the unit of the own object's joint, and within its limits.

    What the scenario asks of a joint that slides is, of one that turns, that way of the handle, and
    the other way round. What the user has given is in the unit of the object's joint.
    """
    differs, to_joint = at_base.unit != facts.unit, _to_joint(at_base, facts)
    old_unit, unit = at_base.unit, facts.unit
    most = _most(facts)
    lines, notes = [], []
    for key in ("opening",) if base.task.goal is None else ("goal", "tolerance"):
        wanted = getattr(base.task, key)
        if f"task.{key}" in given:
            notes.append(f"task.{key} = {wanted:g} is in {unit}")
            continue
        value = float(to_joint * wanted)
        notes.append(f"task.{key} = {wanted:g} {old_unit} of the handle is {value:.3g} {unit}")
        if value > most:
            value = float(most)
            notes[-1] += f", of which its limits leave {value:.3g} {unit}"
        if value != wanted:
            lines.append(f"task.{key}={value}")
    if differs:
        warnings.warn(
            f"the scenario's joint is {at_base.joint_type}, '{joint}' is {facts.joint_type}, so"
            f" {', '.join(notes)}",
            ObjectWarning,
            stacklevel=3,
        )
    return lines


def _numbers(option: str, text: str, count: int) -> list[float]:
    try:
        values = [float(part) for part in text.split(",")]
    except ValueError:
        values = []
    if len(values) != count or not np.all(np.isfinite(values)):
        raise ScenarioError(f"{option} {text}: expected {count} numbers with commas between them")
    return values


def keep_files(scenario: Scenario) -> tuple[Scenario, dict[str, Path]]:
    """The scenario with imported models below `model` of a run's folder, and these models' files.

    Returns:
        The scenario, and by their places in the folder the files that it needs there.
    """
    objects, files = {}, {}
    for name, thing in scenario.objects.items():
        model = Path(thing.model)
        if model.is_absolute():
            place = MODEL_FOLDER if len(scenario.objects) == 1 else f"{MODEL_FOLDER}/{name}"
            for path in copied_files(model):
                inside = path.resolve().relative_to(model.parent.resolve()).as_posix()
                files[f"{place}/{MODEL_FILE if path == model else inside}"] = path
            thing = replace(thing, model=f"{place}/{MODEL_FILE}")
        objects[name] = thing
    return replace(scenario, objects=objects), files
