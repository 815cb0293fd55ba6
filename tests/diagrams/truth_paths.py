"""Where the simulation's truth can flow to: nowhere but into sensors and the evaluation.

Two ways lead to it: wires, and Python references to the simulated plant, its scene graph, a part of
them or a context of theirs.
"""

import functools
import types
from collections import defaultdict
from collections.abc import Iterator
from typing import Any

from pydrake.geometry import SceneGraph
from pydrake.multibody.plant import MultibodyPlant
from pydrake.systems.framework import Context, Diagram, System

from crossmodal.diagrams.drawing.diagram_drawing import leaf_systems, wires
from crossmodal.systems.sensors.rgbd_camera import CameraNoise
from crossmodal.systems.sensors.sampled_sensor import SampledSensor

# What turns truth into measurements: a path ends here.
SENSORS = (CameraNoise, SampledSensor)
# What may know the truth besides sensors: what simulates, wires, records and draws.
WORLD_ROOMS = ("crossmodal.plants", "crossmodal.diagrams", "pydrake")


def truth_paths(diagram: Diagram) -> list[str]:
    """Every chain of wires from the plant to a filter or controller that avoids all sensors.

    Returns:
        One line per reached system; empty if nothing true reaches what the robot runs.
    """
    targets: dict[System, list[tuple[str, System]]] = defaultdict(list)
    for wire in wires(diagram):
        if wire.source is not None:
            targets[wire.source].append((wire.source_port, wire.target))
    start = [system for system in leaf_systems(diagram) if isinstance(system, MultibodyPlant)]
    reached: dict[System, str] = {system: system.get_name() for system in start}
    queue = list(start)
    while queue:
        source = queue.pop()
        for port, target in targets[source]:
            if target in reached or isinstance(target, SENSORS):
                continue
            reached[target] = f"{reached[source]}.{port} -> {target.get_name()}"
            queue.append(target)
    return [path for system, path in reached.items() if _belongs_to_robot(system)]


def _belongs_to_robot(system: System) -> bool:
    module = type(system).__module__
    is_sensor = isinstance(system, SENSORS) or module.startswith("crossmodal.systems.sensors.")
    of_the_world = module.startswith(tuple(f"{room}." for room in WORLD_ROOMS))
    return not of_the_world and not is_sensor


def truth_references(diagram: Diagram) -> list[str]:
    """Every filter and controller from which Python references lead to the simulated world.

    Returns:
        One line per reference that was found; empty if nobody of the robot holds any.
    """
    leaves = leaf_systems(diagram)
    plants = [system for system in leaves if isinstance(system, MultibodyPlant)]
    scenes = [
        wire.target
        for wire in wires(diagram)
        if wire.source in plants and isinstance(wire.target, SceneGraph)
    ]
    found = []
    for system in leaves:
        if not _belongs_to_robot(system):
            continue
        for path, held in _reachable(system, type(system).__name__):
            what = _is_of_the_world(held, plants, scenes)
            if what:
                found.append(f"{path}: {what}")
    return found


def _is_of_the_world(
    held: Any, plants: list[MultibodyPlant], scenes: list[SceneGraph]
) -> str | None:
    for world in (*plants, *scenes):
        if held is world:
            return f"the simulation's {type(world).__name__}"
    if isinstance(held, Context):
        for world in (*plants, *scenes):
            if _is_context_of(held, world):
                return f"a context of the simulation's {type(world).__name__}"
    if hasattr(type(held), "GetParentPlant") and held.GetParentPlant() in plants:
        return f"a {type(held).__name__} of the simulated plant"
    return None


def _is_context_of(context: Context, system: System) -> bool:
    try:
        system.ValidateContext(context)
    except (RuntimeError, ValueError):
        return False
    return True


def _reachable(start: object, name: str) -> Iterator[tuple[str, Any]]:
    """All that can be reached from an object by Python references, each once, with its path."""
    seen = {id(start)}
    waiting = [(name, start)]
    while waiting:
        path, thing = waiting.pop()
        for label, held in _referents(thing):
            if id(held) in seen:
                continue
            seen.add(id(held))
            yield f"{path}{label}", held
            waiting.append((f"{path}{label}", held))


def _referents(thing: Any) -> Iterator[tuple[str, Any]]:
    if isinstance(thing, dict):
        for key, value in thing.items():
            yield f"[{key!r}]", value
    elif isinstance(thing, list | tuple | set | frozenset):
        for index, value in enumerate(thing):
            yield f"[{index}]", value
    elif isinstance(thing, functools.partial):
        yield ".func", thing.func
        yield ".args", thing.args
        yield ".keywords", thing.keywords
    elif isinstance(thing, types.FunctionType):
        for index, cell in enumerate(thing.__closure__ or ()):
            yield f".closure[{index}]", cell.cell_contents
        yield ".defaults", thing.__defaults__
    elif hasattr(thing, "__self__"):  # A bound method of Python's, pybind11's or nanobind's.
        yield ".__self__", thing.__self__
    elif not isinstance(thing, type | types.ModuleType):
        for key, value in getattr(thing, "__dict__", {}).items():
            # By these Drake keeps a diagram and its systems alive together.
            if not key.startswith("_pydrake_internal"):
                yield f".{key}", value
