"""Names and paths that have changed: the old ones go on for two minor releases more, with a warning.

Each old path becomes a module that finds its names in the new ones, so that old and new names are the
same objects.
"""

import sys
import warnings
from importlib import import_module
from importlib.machinery import ModuleSpec

from aimd_des.utils.deprecation import REMOVED_IN, SINCE, renamed

# Nothing is imported here that takes time: every program that imports the package waits for it.
TYPE_CHECKING = False
if TYPE_CHECKING:
    from collections.abc import Sequence
    from importlib.abc import Loader, MetaPathFinder
    from types import ModuleType
    from typing import Any

    class _Finder(MetaPathFinder, Loader):
        """What Python requires of finders and loaders of modules; they need no common ancestor."""
else:
    _Finder = object

__all__ = ["MOVED", "NAMES", "install", "new_name"]

#: Old names at the top of the package, each with the new one and the version that has brought it.
NAMES: dict[str, tuple[str, str]] = {
    "run_discrete": ("run_synchronous", SINCE),
}
#: Old paths, each with the modules in which its names are now; the first is the one to import instead.
MOVED: dict[str, tuple[str, ...]] = {
    "aimd_des.agents": ("aimd_des", "aimd_des.fleet", "aimd_des.engine.agent_process"),
    "aimd_des.clock": ("aimd_des", "aimd_des.dynamics.clocks"),
    "aimd_des.control_unit": ("aimd_des", "aimd_des.engine.control_unit"),
    "aimd_des.discrete": ("aimd_des", "aimd_des.synchronous.synchronous"),
    "aimd_des.elementary": ("aimd_des.lowlevel", "aimd_des.utils.portable_math"),
    "aimd_des.environment": ("aimd_des.lowlevel", "aimd_des.engine.environment"),
    "aimd_des.errors": ("aimd_des", "aimd_des.utils.errors"),
    "aimd_des.optimum": ("aimd_des", "aimd_des.problem.optimum"),
    "aimd_des.output": ("aimd_des.scenario", "aimd_des.scenario.run_folder", "aimd_des.utils.folders"),
    "aimd_des.recording": ("aimd_des", "aimd_des.results.recording"),
    "aimd_des.registry": ("aimd_des", "aimd_des.scenario.models"),
    "aimd_des.response": ("aimd_des.lowlevel", "aimd_des.dynamics.demand"),
    "aimd_des.simulation": ("aimd_des", "aimd_des.engine.simulation"),
    "aimd_des.stored": ("aimd_des.scenario", "aimd_des.scenario.run_folder"),
    "aimd_des.streams": ("aimd_des.lowlevel", "aimd_des.utils.rng"),
    "aimd_des.system": ("aimd_des.lowlevel", "aimd_des.engine.system"),
    "aimd_des.transport": ("aimd_des.lowlevel", "aimd_des.engine.delivery"),
}


def new_name(old: str) -> str | None:
    """Say what an old name is called now, with a warning; nothing is returned for what is none."""
    if old not in NAMES:
        return None
    new, since = NAMES[old]
    # Told where the name was asked for.
    warnings.warn(renamed(f"aimd_des.{old}", new, since), DeprecationWarning, stacklevel=3)
    return new


class _OldPaths(_Finder):
    """Finds old paths, and nothing else."""

    def find_spec(
        self, fullname: str, path: "Sequence[str] | None", target: "ModuleType | None" = None
    ) -> ModuleSpec | None:
        """Answer for an old path."""
        return ModuleSpec(fullname, self) if fullname in MOVED else None

    def create_module(self, spec: "ModuleSpec") -> None:
        """Let the module be made as others are."""

    def exec_module(self, module: "ModuleType") -> None:
        """Warn, and let the new modules give every name that is asked for."""
        old = module.__name__
        message = f"{old} has moved: import from {MOVED[old][0]}; the old path ends with {REMOVED_IN}"
        warnings.warn(message, DeprecationWarning, stacklevel=2)

        def look_up(name: str) -> "Any":
            for new in MOVED[old]:
                try:
                    return getattr(import_module(new), name)
                except AttributeError:
                    continue
            raise AttributeError(f"module {old!r} has no attribute {name!r}")

        vars(module)["__getattr__"] = look_up


def install() -> None:
    """Let old paths be imported from now on."""
    if not any(isinstance(finder, _OldPaths) for finder in sys.meta_path):
        sys.meta_path.append(_OldPaths())
