"""Draws a Diagram of filters from its connections, bottom up.

Blue solid arrows carry measurements up, red dashed ones predictions and priors down.
"""

import html
import re
import shutil
import subprocess
from collections import defaultdict
from dataclasses import dataclass

from pydrake.systems.framework import (
    Diagram,
    DiagramBuilder,
    InputPortIndex,
    OutputPortIndex,
    System,
)

_PREDICTION = re.compile(r"(_predicted|_predictions|_prior|_latest)$")
_ROLE = re.compile(r"_(measured|estimated|predicted|latest|desired|commanded|window)$")
_ROOM = "crossmodal.systems."  # Systems of its sub-packages are drawn together.
_OUTLINES = ("#AA3377", "#EE7733", "#4477AA", "#228833", "#777777")
_FILLS = ("#F8EAF1", "#FDF0E5", "#E9F0F7", "#E9F3EB", "#F3F3F3")
_UP, _DOWN = "#2F5FA8", "#C8342B"
_OTHER = "#777777"


@dataclass(frozen=True, kw_only=True)
class Wire:
    """A connection between two leaf systems; the source of an input from outside has no system."""

    source: System | None
    source_port: str
    target: System
    target_port: str

    @property
    def is_prediction(self) -> bool:
        """Whether it flows down: from a state, not from this tick's measurements."""
        return bool(_PREDICTION.search(self.source_port))


def wires(diagram: Diagram) -> list[Wire]:
    """All connections between the leaf systems of a Diagram and from its own inputs."""
    found: list[Wire] = []
    for level in _diagrams(diagram):
        for (target, input_index), (source, output_index) in level.connection_map().items():
            leaf, port = _leaf_output(source, output_index)
            for inner, inner_index in _leaf_inputs(target, input_index):
                name = inner.get_input_port(inner_index).get_name()
                found.append(Wire(source=leaf, source_port=port, target=inner, target_port=name))
    for index in range(diagram.num_input_ports()):
        port_name = diagram.get_input_port(InputPortIndex(index)).get_name()
        for inner, inner_index in _leaf_inputs(diagram, InputPortIndex(index)):
            name = inner.get_input_port(inner_index).get_name()
            found.append(Wire(source=None, source_port=port_name, target=inner, target_port=name))
    return found


def _diagrams(diagram: Diagram) -> list[Diagram]:
    nested = [system for system in diagram.GetSystems() if isinstance(system, Diagram)]
    return [diagram, *(level for inner in nested for level in _diagrams(inner))]


def _leaf_output(system: System, index: OutputPortIndex) -> tuple[System, str]:
    while isinstance(system, Diagram):
        system, index = system.get_output_port_locator(index)
    return system, system.get_output_port(index).get_name()


def _leaf_inputs(system: System, index: InputPortIndex) -> list[tuple[System, InputPortIndex]]:
    if not isinstance(system, Diagram):
        return [(system, index)]
    return [
        leaf
        for inner, inner_index in system.GetInputPortLocators(index)
        for leaf in _leaf_inputs(inner, inner_index)
    ]


def leaf_systems(diagram: Diagram) -> list[System]:
    """The systems of a Diagram and of the Diagrams in it."""
    leaves: list[System] = []
    for system in diagram.GetSystems():
        leaves += leaf_systems(system) if isinstance(system, Diagram) else [system]
    return leaves


def words(name: str) -> str:
    """'EndEffectorMotion' or 'end_effector_motion' as 'end effector motion'."""
    spaced = re.sub(r"(?<=[a-z0-9])(?=[A-Z])|_", " ", name.rpartition("/")[2])
    return spaced.strip().lower()


def _quantity(port: str) -> str:
    return words(_ROLE.sub("", port))


def _package(system: System) -> str:
    return ".".join(type(system).__module__.split(".")[:3])


def _of_one(system: System) -> Diagram:
    """A Diagram of a single system, with that system's inputs."""
    builder = DiagramBuilder()
    builder.AddSystem(system)
    for index in range(system.num_input_ports()):
        builder.ExportInput(system.get_input_port(index), system.get_input_port(index).get_name())
    return builder.Build()


def diagram_dot(diagram: System, title: str) -> str:
    """The drawing of a Diagram, or of a single system, in Graphviz's language."""
    if not isinstance(diagram, Diagram):
        diagram = _of_one(diagram)
    systems = leaf_systems(diagram)
    names = {system: f"n{index}" for index, system in enumerate(systems)}
    groups: dict[str, list[System]] = defaultdict(list)
    for system in systems:
        groups[_package(system)].append(system)
    lines = [
        "digraph diagram {",
        f"  graph [rankdir=BT, label={_heading(title)}, labelloc=t, fontsize=13, nodesep=0.45,"
        " ranksep=0.75, splines=true, newrank=true, pad=0.3];",
        '  graph [fontname="Helvetica"]; node [fontname="Helvetica", fontsize=13];',
        '  edge [fontname="Helvetica", fontsize=10];',
        '  node [shape=box, style="rounded,filled", penwidth=1.4, margin="0.18,0.1"];',
    ]
    packages = sorted(package for package in groups if package.startswith(_ROOM))
    all_wires = wires(diagram)
    for package, members in groups.items():
        index = packages.index(package) % len(_OUTLINES) if package in packages else None
        lines += _cluster_lines(package, members, names, index, all_wires)
    outside = dict.fromkeys(wire.source_port for wire in all_wires if wire.source is None)
    for index, port in enumerate(outside):
        lines.append(
            f'  in{index} [label="{_quantity(port)}", shape=plain, style="", fontcolor="#555555"];'
        )
        lines += [
            _edge_line(wire, f"in{index}", names[wire.target])
            for wire in all_wires
            if wire.source is None and wire.source_port == port
        ]
    lines += [
        _edge_line(wire, names[wire.source], names[wire.target])
        for wire in all_wires
        if wire.source is not None
    ]
    inputs = "; ".join(f"in{index}" for index in range(len(outside)))
    lines += [f"  {{ rank=min; {inputs} }}" if outside else "", "}"]
    return "\n".join(lines) + "\n"


def _cluster_lines(
    package: str,
    members: list[System],
    names: dict[System, str],
    index: int | None,
    all_wires: list[Wire],
) -> list[str]:
    """The systems of a package; `index` of its colours, None for systems without a frame."""
    outline = _OTHER if index is None else _OUTLINES[index]
    nodes = [
        f'    {names[system]} [label="{_label(system)}", color="{outline}", fillcolor=white];'
        for system in members
    ]
    if index is None:
        return nodes
    title = package.removeprefix(_ROOM).capitalize()
    feeding = {
        wire.source for wire in all_wires if wire.target in members and not wire.is_prediction
    }
    top = next((system for system in members if system not in feeding), members[0])
    # Wires keep clear of nodes but not of a cluster's label: so its title is a node.
    return [
        f'  subgraph "cluster_{title}" {{',
        f'    label=""; style="rounded,filled"; color="{_FILLS[index]}"; margin=14;',
        f'    "{title}" [shape=plain, style="", fontsize=15, fontcolor="{outline}"];',
        *nodes,
        f'    {{ rank=same; "{title}" -> {names[top]} [style=invis]; }}',
        "  }",
    ]


def _label(system: System) -> str:
    """What a system is and, where it differs, what it is called here."""
    kind, name = words(type(system).__name__), words(system.get_name())
    if not name or "@" in name:  # Drake's own name for what was given none.
        return kind
    return name if kind in name else f"{kind}\\n{name}"


def _edge_line(wire: Wire, source: str, target: str) -> str:
    style = (
        f'color="{_DOWN}", fontcolor="{_DOWN}", style=dashed, constraint=false'
        if wire.is_prediction
        else f'color="{_UP}", fontcolor="{_UP}"'
    )
    label = "" if wire.source is None else _quantity(wire.source_port)
    tooltip = f"{wire.source_port} to {wire.target_port}"
    return f'  {source} -> {target} [label="{label}", {style}, penwidth=1.5, tooltip="{tooltip}"];'


def _heading(title: str) -> str:
    """Title and key as one of Graphviz's HTML labels."""
    key = (
        f'<font color="{_UP}">━▶ measurements, up</font>'
        f'<font color="{_DOWN}">      ╍▶ predictions and priors, down</font>'
    )
    return f'<<font point-size="20">{html.escape(title)}</font><br/>{key}<br/> >'


def render_svg(dot: str) -> str:
    """The drawing as SVG, made by Graphviz.

    Raises:
        RuntimeError: where Graphviz is not installed or cannot draw it.
    """
    program = shutil.which("dot")
    if program is None:
        raise RuntimeError(
            "Graphviz's 'dot' is not installed; install the system package 'graphviz'"
            " (sudo apt install graphviz, or brew install graphviz)"
        )
    done = subprocess.run(
        [program, "-Tsvg"], input=dot, capture_output=True, text=True, check=False
    )
    if done.returncode != 0:
        raise RuntimeError(f"dot failed: {' '.join(done.stderr.split())}")
    return done.stdout
