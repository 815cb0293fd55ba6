"""What every scenario of a station can get wrong beside the ranges of its numbers."""

from collections.abc import Iterable, Sequence
from pathlib import Path

from crossmodal.diagrams.run.scenario import Scenario
from crossmodal.diagrams.run.variants import check_variants, with_variants
from crossmodal.diagrams.run.yaml_input.schema import ScenarioError, suggestion
from crossmodal.models import SDF_DIR


def check_one_camera(scenario: Scenario, source: str, what: str) -> None:
    """Refuses all but one camera that is fixed to the world, which `what` needs."""
    if [camera.base_frame for camera in scenario.cameras.values()] != ["world"]:
        raise ScenarioError(
            f"{source}: cameras: {what} through one camera that is fixed to the world"
        )


def check_estimators(
    scenario: Scenario, chosen: Sequence[str], known: Sequence[str], source: str
) -> list[str]:
    """The estimators that run: the chosen ones, and the variants of the scenario.

    Args:
        chosen: Names, of the known ones or of variants.
        known: The estimators of the application.
        source: The scenario's file, for messages.

    Raises:
        ScenarioError: for one that there is not, none at all, and one that is named twice.
    """
    check_variants(scenario.variants, known, source)
    names = with_variants(chosen, scenario.variants)
    for name in names:
        if name not in (*known, *scenario.variants):
            hint = suggestion(name, [*known, *scenario.variants])
            raise ScenarioError(f"{source}: modalities: unknown modality '{name}'; {hint}")
    if not names or len(set(names)) < len(names):
        raise ScenarioError(
            f"{source}: modalities = {names}, but it must name each once, at least one"
        )
    return names


def check_scene(scene: str, source: str) -> None:
    """Refuses a scene's file that is not there."""
    if not (SDF_DIR / scene).is_file():
        raise ScenarioError(
            f"{source}: plant.scene = '{scene}': there is no such file in {SDF_DIR}"
        )


def check_textures(textures: Iterable[str], key: str) -> None:
    """Refuses a texture that is not there, and suggests another one."""
    known = [path.stem for path in (SDF_DIR / "textures").glob("*.png")]
    for texture in textures:
        if texture not in known:
            raise ScenarioError(f"{key}: unknown texture '{texture}'; {suggestion(texture, known)}")


def model_file(model: str, key: str, scenario_path: Path) -> Path:
    """The file of a model beside the scenario's own, absolute, or in models/sdf.

    Raises:
        ScenarioError: where there is none.
    """
    candidates = [scenario_path.parent / model, SDF_DIR / model]
    for candidate in candidates:
        if candidate.is_file():
            return candidate.resolve()
    places = " or ".join(str(candidate.parent) for candidate in candidates)
    raise ScenarioError(f"{scenario_path}: {key} = '{model}': there is no such file in {places}")
