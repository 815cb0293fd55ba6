"""Compiles what an episode calls, before it begins and in processes of their own.

The compiler takes minutes and some hundred megabytes, which the process that runs the episode would
keep. So two others fill the cache on the disk first: one goes through the list of functions from
its beginning, the other from its end, until they meet. `compiled_ahead.yaml` is that list: for
each application the functions that Python calls, with the types that it calls them with. What they
call in turn is compiled with them. A function that is missing in the list is compiled where it is
called.
"""

import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from importlib import import_module
from pathlib import Path
from typing import Any

import yaml
from numba import types
from numba.core.event import trigger_event
from numba.core.registry import CPUDispatcher

LIST = Path(__file__).with_name("compiled_ahead.yaml")
_ORDERS = (1, -1)  # Of the two processes.


def listed(application: str) -> Iterator[tuple[Any, tuple[types.Type, ...]]]:
    """The functions listed for an application, and the types of their arguments.

    Only those whose modules are imported. An application that is not in the list may call any.
    """
    document = yaml.safe_load(LIST.read_text())
    names: dict[str, Any] = {**vars(types), "bool": types.boolean}
    for name, fields in document["named_tuples"].items():
        if (of := _imported(name)) is not None:
            names[of.__name__] = types.BaseTuple.from_types(eval(f"({fields},)", names), of)
    of_each: dict[str, dict[str, list[str]]] = document["functions"]
    for functions in [of_each[application]] if application in of_each else of_each.values():
        for name, signatures in functions.items():
            if isinstance(dispatcher := _imported(name), CPUDispatcher):
                yield from ((dispatcher, eval(f"({each},)", names)) for each in signatures)


def _imported(name: str) -> Any:
    module, _, attribute = name.rpartition(".")
    return getattr(sys.modules[module], attribute) if module in sys.modules else None


def is_kept(dispatcher: Any) -> bool:
    """Whether the disk holds compiled code of this function as it is now."""
    module = Path(dispatcher.py_func.__code__.co_filename).stem
    kept = Path(dispatcher.stats.cache_path).glob(f"{module}.{dispatcher.__name__}-*.nbi")
    return next(kept, None) is not None


def compile_listed(application: str, order: int, modules: list[str]) -> None:
    """Compiles the functions of these modules from the list's beginning (1) or its end (-1)."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)  # An interrupt ends it without a word.
    for module in modules:
        import_module(module)
    for dispatcher, signature in list(listed(application))[::order]:
        dispatcher.compile(signature)


def compile_ahead(application: str) -> None:
    """Returns when the code of all functions listed for an application is on the disk.

    To those who listen (`compilation_timed`) it is as if this process compiled.
    """
    missing = [dispatcher for dispatcher, _ in listed(application) if not is_kept(dispatcher)]
    if not missing:
        return
    modules = sorted({dispatcher.__module__ for dispatcher in missing})
    calls = [f"compile_listed({application!r}, {order}, {modules})" for order in _ORDERS]
    processes = [
        subprocess.Popen(
            [sys.executable, "-c", f"from {__name__} import *; {call}"],
            env=os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)},
        )
        for call in calls
    ]
    try:
        with trigger_event("numba:compile"):
            for process in processes:
                process.wait()
    finally:
        for process in processes:
            process.kill()
