"""Variants of estimators: under a name of one's own, one that there is with other filters in it.

A scenario names them, so that `run`, `replay` and `evaluate` have them without a line of Python:

    variants:
      mine: {of: crossmodal, replacements: {hand_bending: my_filters.py:MyBending}}
"""

import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from crossmodal.diagrams.run.own_module import load_module
from crossmodal.diagrams.run.yaml_input.schema import ScenarioError, suggestion

FOLDER = "filters"  # Of a run's folder, with the files of the filters.
_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_-]*")  # It becomes part of ports' and files' names.


@dataclass(kw_only=True)
class Variant:
    """An estimator with filters replaced."""

    of: str = ""  # The estimator that is varied.
    # By the filter's name, who makes the other one: `FILE.py:NAME` or `module:NAME`.
    replacements: dict[str, str] = field(default_factory=dict)

    def makers(self, key: str) -> dict[str, Callable[..., Any]]:
        """Who makes the other filters, by the names of the filters in whose place they are.

        Args:
            key: Of the variant in its scenario, for messages.

        Raises:
            ScenarioError: where one cannot be imported, with its key and why.
        """
        return {
            name: _imported(reference, f"{key}.replacements.{name}")
            for name, reference in self.replacements.items()
        }


def _parts(reference: str, key: str) -> tuple[str, str]:
    source, colon, name = reference.rpartition(":")
    if not colon or not source or not name:
        raise ScenarioError(
            f"{key} = '{reference}', but it must be FILE.py:NAME or module:NAME, such as"
            " my_filters.py:MyFilter"
        )
    return source, name


def _imported(reference: str, key: str) -> Callable[..., Any]:
    source, name = _parts(reference, key)
    module = load_module(source, f"{key} = '{reference}'")
    found = getattr(module, name, None)
    if not callable(found):
        own = [word for word, value in vars(module).items() if callable(value)]
        own = [word for word in own if not word.startswith("_")]
        raise ScenarioError(
            f"{key} = '{reference}': {source} has no class or function '{name}';"
            f" {suggestion(name, own)}"
        )
    made: Callable[..., Any] = found
    return made


def check_variants(
    variants: Mapping[str, Variant], known: Iterable[str], source: str, own: str = "variants"
) -> None:
    """Refuses a variant without a name of its own, and one of an estimator that there is not.

    Args:
        known: The estimators that come with the application.
        source: The scenario's file, for the message.
        own: Key of the variants in the scenario.
    """
    known = list(known)
    for name, variant in variants.items():
        if name in known:
            raise ScenarioError(
                f"{source}: {own}.{name}: is the name of an estimator that there is; choose another"
            )
        if not _NAME.fullmatch(name):
            raise ScenarioError(
                f"{source}: {own}: '{name}' must be letters, digits, _ and - for a variant's name"
            )
        if variant.of not in known:
            raise ScenarioError(
                f"{source}: {own}.{name}.of = '{variant.of}', but it must be the estimator that is"
                f" varied; {suggestion(variant.of, known)}"
            )


def with_variants(names: Sequence[str], variants: Mapping[str, Variant]) -> list[str]:
    """Names of estimators, and those of the variants that are not among them."""
    return [*names, *(name for name in variants if name not in names)]


def asked_for(
    variants: Mapping[str, Variant], modalities: Sequence[str], overrides: Sequence[str]
) -> dict[str, Variant]:
    """The variants that run: where an override names the estimators, no other one of the file's.

    Args:
        modalities: Names of the scenario's estimators.
        overrides: Assignments `key.path=value` that were made to it.
    """
    keys = [assignment.partition("=")[0].strip() for assignment in overrides]
    if "modalities" not in keys:
        return dict(variants)
    made = {key.split(".")[1] for key in keys if key.startswith("variants.")}
    return {name: variants[name] for name in variants if name in {*modalities, *made}}


def with_files_found(variants: Mapping[str, Variant], path: Path) -> dict[str, Variant]:
    """The variants with absolute paths: of a file beside the scenario's, or in the current folder.

    Args:
        path: The scenario's file.

    Raises:
        ScenarioError: where there is no such file.
    """
    return {
        name: replace(
            variant,
            replacements={
                place: _found(reference, path, f"{path}: variants.{name}.replacements.{place}")
                for place, reference in variant.replacements.items()
            },
        )
        for name, variant in variants.items()
    }


def _found(reference: str, path: Path, key: str) -> str:
    source, name = _parts(reference, key)
    if not source.endswith(".py"):
        return reference
    for folder in (path.parent, Path.cwd()):
        if (folder / source).is_file():
            return f"{(folder / source).resolve()}:{name}"
    places = " or ".join(dict.fromkeys([str(path.parent.resolve()), str(Path.cwd())]))
    raise ScenarioError(f"{key} = '{reference}': there is no {source} in {places}")


def with_files_kept(variants: Mapping[str, Variant]) -> tuple[dict[str, Variant], dict[str, Path]]:
    """The variants with their files below `filters` of a run's folder, and these files.

    Returns:
        The variants, and by their places in the folder the files to be copied there.
    """
    kept, files = {}, dict[str, Path]()
    for name, variant in variants.items():
        references = dict(variant.replacements)
        for place, reference in variant.replacements.items():
            source, maker = _parts(reference, f"variants.{name}.replacements.{place}")
            if source.endswith(".py"):
                inside = f"{FOLDER}/{name}/{place}/{Path(source).name}"
                files[inside] = Path(source)
                references[place] = f"{inside}:{maker}"
        kept[name] = replace(variant, replacements=references)
    return kept, files


def modules_of(variants: Mapping[str, Variant]) -> list[str]:
    """The modules by name that replacements are imported from, other than files."""
    sources = [
        reference.rpartition(":")[0]
        for variant in variants.values()
        for reference in variant.replacements.values()
    ]
    return list(dict.fromkeys(source for source in sources if not source.endswith(".py")))
