"""What files name by module: found by reading it, and imported only where it registers that."""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from importlib import import_module
from importlib.metadata import entry_points

from aimd_des.scenario.module_source import decorated, modules_in, source_of
from aimd_des.utils import validation
from aimd_des.utils.errors import InputError
from aimd_des.utils.parts import MODEL, REGISTERED, Registered

# An installed package names the modules with its parts under this group of entry points.
_ENTRY_POINTS = "aimd_des_parts"

# Where models and parts are looked for without a module's name.
_MODELS = "models"


@dataclass(frozen=True)
class Names:
    """How a file names things of one sort."""

    word: str  # what each is
    key: str  # under which it is named
    decorators: frozenset[str]  # what registers it, called as it can be imported
    remedy: str  # what its author has to do
    alone: bool  # whether a module that registers one only is a name of it

    def find(self, name: str) -> Registered:
        """Find what a name means, and import its module.

        A module that registers nothing of the sort is not imported: that is read in its source.
        """
        module, own = self._called(name)
        if module not in REGISTERED:
            self._import(module)
        if own not in self._registered(module):
            allowed = f"a module that registers a {self.word} when it is imported"
            raise InputError.of(self.key, name, allowed)
        return REGISTERED[module][own]

    def within(self, module: str) -> list[str]:
        """Name what a module registers, as a file can; nothing is imported."""
        try:
            found = self._own_names(module) or []
        except InputError:
            return []
        return [module] if self.alone and len(found) == 1 else [f"{module}.{own}" for own in found]

    def _called(self, name: str) -> tuple[str, str]:
        """Say what in which module a name means."""
        own = self._own_names(name)
        if own is not None and len(own) == 1 and self.alone:
            return name, own[0]
        if own:
            raise InputError.of(self.key, name, f"one of {', '.join(f'{name}.{one}' for one in own)}")
        module, _, last = name.rpartition(".")
        above = (self._own_names(module) if module else None) or []
        if last in above:
            return module, last
        if own is not None:
            raise InputError.of(self.key, name, f"a module that registers a {self.word}", self.remedy)
        beside = [*(f"{module}.{one}" for one in above), *(modules_in(module) if module else ())]
        remedy = validation.nearest(name, beside) or "install it, or run from the folder that holds it"
        raise InputError.of(self.key, name, "a module on the Python path or in the working directory", remedy)

    def _registered(self, module: str) -> list[str]:
        """Name what a module has registered of this sort; parts of ours have names of their own."""
        return [
            own
            for own, thing in REGISTERED.get(module, {}).items()
            if (thing.group == MODEL) == (self.word == MODEL) and thing.name == f"{module}.{own}"
        ]

    def _own_names(self, module: str) -> list[str] | None:
        """Name what a module has registered, or would; None if there is no such module."""
        if module not in REGISTERED and self.word != MODEL and module in declared_modules():
            self._import(module)
        if module in REGISTERED:
            return self._registered(module)
        try:
            source = source_of(module)
            return None if source is None else list(decorated(source, self.decorators))
        except (ImportError, SyntaxError, ValueError, RecursionError, MemoryError) as error:  # no Python
            raise self._not_imported(module, error) from error

    def _import(self, module: str) -> None:
        try:
            import_module(module)
        except (Exception, SystemExit) as error:  # anything that a module of the user's raises
            REGISTERED.pop(module, None)  # what it had registered before
            raise self._not_imported(module, error) from error

    def _not_imported(self, module: str, error: BaseException) -> InputError:
        """Say that a module is broken."""
        allowed = f"a module that can be imported, and this one raises {type(error).__name__}: {error}"
        return InputError.of(self.key, module, allowed)


#: Functions that return a problem.
MODELS = Names(
    "model",
    "model",
    frozenset({"aimd_des.model", "aimd_des.registry.model", "aimd_des.scenario.models.model"}),
    "decorate its function with aimd_des.model",
    alone=True,
)

#: Classes and functions of all other groups.
PARTS = Names(
    "part",
    "kind",
    frozenset({"aimd_des.lowlevel.part", "aimd_des.utils.parts.part"}),
    "decorate its class with aimd_des.lowlevel.part, and name module and class",
    alone=False,
)


@cache
def declared_modules() -> tuple[str, ...]:
    """Name the modules that installed packages declare to have parts."""
    return tuple(dict.fromkeys(entry.module for entry in entry_points(group=_ENTRY_POINTS)))


def modules_around() -> Iterator[str]:
    """Name the modules that are looked through: of `models`, of this folder, and declared ones."""
    yield from dict.fromkeys((_MODELS, *modules_in(_MODELS), *modules_in(), *declared_modules()))
