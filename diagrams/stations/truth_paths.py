"""Where the simulation's truth can flow to: nowhere but into sensors and the evaluation."""

from collections import defaultdict

from pydrake.multibody.plant import MultibodyPlant
from pydrake.systems.framework import Diagram, System

from diagrams.drawing.diagram_drawing import leaf_systems, wires
from systems.sensors.air_pressure import PressureSensor
from systems.sensors.joint_encoders import JointEncoders
from systems.sensors.rgbd_camera import CameraNoise
from systems.sensors.wrist_wrench import WristWrenchSensor

# What turns truth into measurements: a path ends here.
SENSORS = (CameraNoise, JointEncoders, PressureSensor, WristWrenchSensor)
ROBOT_ROOMS = ("systems", "controllers")  # What may know measurements only.


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
    room = module.partition(".")[0]
    return room in ROBOT_ROOMS and not module.startswith("systems.sensors")
