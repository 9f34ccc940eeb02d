"""Parts of compiled code, which Numba neither optimises nor turns into machine code on their own.

Numba optimises each function that it compiles, makes machine code of it and keeps that on the disk, also
where nothing but a copy of it inside its callers is ever run.  A *part* stops earlier: it is typed and
becomes LLVM's code, which each caller takes in and optimises with its own.

Numba has no option for it.  What is overridden here is private to Numba, and the same in all versions that
`_TESTED` spans.  With another version, or where a name is missing, there are no parts, and each function is
compiled on its own: it takes longer, and gives the same bits.
"""

from typing import Any

import numba
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import CompilerBase, DefaultPassBuilder, Flags
from numba.core.compiler_machinery import LoweringPass, PassManager, register_pass
from numba.core.dispatcher import Dispatcher
from numba.core.typed_passes import NativeLowering

__all__ = ["PartCompiler", "are_as_expected", "take_in"]

#: The first version of Numba in which parts are tested, and the first in which they are not.
_TESTED = ((0, 60), (0, 69))

# What is overridden or called here, by the class that has it.
_NAMES: dict[type, tuple[str, ...]] = {
    JITCodeLibrary: (
        "_ensure_finalized",
        "_finalize_dynamic_globals",
        "_finalize_final_module",
        "_get_module_for_linking",
        "_optimize_final_module",
    ),
    CompilerBase: ("define_pipelines",),
    DefaultPassBuilder: ("define_nopython_pipeline",),
    Dispatcher: ("get_call_template", "get_overload"),
    Flags: ("no_compile",),
    PassManager: ("add_pass_after", "finalize"),
}


def are_as_expected(version: str = numba.__version__) -> bool:
    """Whether Numba is of a version that was tested, and has all that is overridden here."""
    numbers = tuple(int(word) for word in version.split(".")[:2] if word.isdigit())
    first, beyond = _TESTED
    names = ((owner, name) for owner, names in _NAMES.items() for name in names)
    return first <= numbers < beyond and all(hasattr(owner, name) for owner, name in names)


class _PartLibrary(JITCodeLibrary):  # type: ignore[misc]  # numba has no type information
    """LLVM's code of a part, for its callers to take in."""

    def _optimize_final_module(self) -> None:
        """Leave that to the callers, which optimise their copies."""

    def mentions(self, name: str) -> int:
        """How often a name is in the code, that of other parts left out if it is not taken in yet."""
        return str(self._final_module).count(name)

    def _finalize_final_module(self) -> None:
        """Let callers take the code in, and make no machine code of it."""
        self._finalize_dynamic_globals()
        self._finalized = True


@register_pass(mutates_CFG=False, analysis_only=False)
class _EnterPart(LoweringPass):  # type: ignore[misc]
    """Enter a part among the functions that compiled code calls, as Numba does with those of machine code."""

    _name = "aimd_des_enter_part"

    def __init__(self) -> None:
        LoweringPass.__init__(self)

    def run_pass(self, state: Any) -> bool:
        """Enter it under an object of its own, which nobody can call."""
        lowered = state["cr"]
        # Only machine code is handed its environment, by which it reaches Python; all code declares one.
        environment = state.targetctx.get_env_name(lowered.fndesc)
        if state.library.mentions(environment) > 1:
            raise NotImplementedError(f"{state.func_id.func_qualname} calls Python")
        # Numba takes nothing but built-in callables here.  This one is new each time, and refuses all calls.
        entry: Any = {}.popitem
        state.targetctx.insert_user_function(entry, lowered.fndesc, [state.library])
        state["cr"] = lowered._replace(cfunc=entry)
        return True


class PartCompiler(CompilerBase):  # type: ignore[misc]
    """Numba's steps, as far as a part takes them; for the option `pipeline_class` of `numba.njit`."""

    def define_pipelines(self) -> list[Any]:
        """Take the steps with the library of a part, and without machine code."""
        state = self.state
        state.library = _PartLibrary(state.targetctx.codegen(), state.func_id.func_qualname)
        state.flags.no_compile = True
        steps = DefaultPassBuilder.define_nopython_pipeline(state)
        steps.add_pass_after(_EnterPart, NativeLowering)
        steps.finalize()
        return [steps]


def take_in(dispatcher: Any, part: Any) -> None:
    """Let compiled code that calls `dispatcher` take in `part`, which is compiled from the same source."""
    dispatcher.get_call_template = part.get_call_template
    dispatcher.get_overload = part.get_overload
