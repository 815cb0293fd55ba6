"""Python of a user's own: a file, or a module that can be imported."""

import importlib
import importlib.util
import sys
from pathlib import Path
from types import ModuleType

from crossmodal.diagrams.run.own_code import told
from crossmodal.diagrams.run.yaml_input.schema import ScenarioError


def load_module(source: str, what: str) -> ModuleType:
    """Imports `FILE.py` or a module by its name.

    Args:
        what: What it is for, the beginning of the message.

    Raises:
        ScenarioError: for whatever goes wrong in it, with the type of the error.
    """
    try:
        if not source.endswith(".py"):
            return importlib.import_module(source)
        path = Path(source).resolve()
        if path.exists() and not path.is_file():  # Nobody may ever write to a pipe.
            raise ImportError(f"{path} is no file")
        name = str(path)  # Another file, or a module of Python's, may have the same stem.
        spec = importlib.util.spec_from_file_location(name, path)
        if spec is None or spec.loader is None:
            raise ImportError(f"{path} is no Python file")
        module = importlib.util.module_from_spec(spec)
        sys.modules[name] = module  # Dataclasses look their module up by name.
        spec.loader.exec_module(module)
    except PermissionError:  # No fault of the file: where compiled code is kept.
        raise
    except Exception as error:  # Whatever a user's own file raises.
        raise ScenarioError(f"{what} cannot be had: {told(error)}") from error
    return module
