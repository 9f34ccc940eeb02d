"""Parts of compiled code, and kernels that are compiled apart from their callers, at their first call.

Numba optimises each function that it compiles, makes machine code of it and keeps that on the disk, also
where only a copy of it inside its callers is ever run.  A *part* stops earlier: it is typed and
becomes LLVM's code, which each caller takes in and optimises with its own.

A *deferred* kernel is the opposite: machine code of its own, which all callers share.  They hold a place for
its address, empty at first, and the types of the arguments, with which they ask for it.  So what a run never
calls is never compiled, and what several kernels call is compiled once.

Both have options that are compared quickly, since Numba compares them thousands of times for a kernel.

Numba has no option for any of this.  What is overridden here is private to Numba, and is the same in all
versions that `_TESTED` spans.  With another version, or where a name is missing, there are no parts, nothing
is deferred, and each function is compiled on its own: it takes longer, and gives the same bits.  Versions
before `_DEFERS_FROM` have parts, and what would be deferred is one.
"""

import pickle
import sys
from collections.abc import Callable
from ctypes import CFUNCTYPE, c_int64, c_void_p, cast, string_at
from typing import Any

import numba
from llvmlite import binding, ir
from numba import _dispatcher, types
from numba.core import cgutils
from numba.core.callconv import CPUCallConv
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import Compiler, CompilerBase, DefaultPassBuilder, Flags
from numba.core.compiler_machinery import LoweringPass, PassManager, register_pass
from numba.core.dispatcher import Dispatcher
from numba.core.typed_passes import NativeLowering
from numba.core.typing.templates import make_concrete_template
from numba.extending import lower_builtin

__all__ = ["PartCompiler", "are_as_expected", "can_defer", "defer", "fingerprint", "take_in"]

#: The first version of Numba in which parts are tested, and the first in which they are not.
_TESTED = ((0, 60), (0, 69))
# The first in which deferred kernels are; before, they are parts like others.
_DEFERS_FROM = (0, 68)

# Before this version, what it returns for a long record is memory that it has given back.
_TELLS_FROM = (0, 68)

# What is overridden or called here, by the class that has it.
_NAMES: dict[type, tuple[str, ...]] = {
    JITCodeLibrary: (
        "_ensure_finalized",
        "_finalize_dynamic_globals",
        "_finalize_final_module",
        "_get_module_for_linking",
        "_optimize_final_module",
        "get_pointer_to_function",
    ),
    CPUCallConv: ("call_function", "get_function_type", "return_status_propagate", "return_user_exc"),
    CompilerBase: ("define_pipelines",),
    DefaultPassBuilder: ("define_nopython_pipeline",),
    Dispatcher: ("get_call_template", "get_overload"),
    Flags: ("is_set", "no_compile", "values"),
    PassManager: ("add_pass_after", "finalize"),
}


def are_as_expected(version: str = numba.__version__) -> bool:
    """Whether Numba is of a version that was tested, and has all that is overridden here."""
    first, beyond = _TESTED
    numbers = _numbers(version)
    names = ((owner, name) for owner, names in _NAMES.items() for name in names)
    return first <= numbers < beyond and all(hasattr(owner, name) for owner, name in names)


def can_defer(version: str = numba.__version__) -> bool:
    """Whether kernels can be compiled apart with this version."""
    return are_as_expected(version) and _numbers(version) >= _DEFERS_FROM


def _numbers(version: str) -> tuple[int, ...]:
    return tuple(int(word) for word in version.split(".")[:2] if word.isdigit())


#: What Numba tells the types of an argument by at each call; none where it cannot be asked.
fingerprint: Callable[[object], Any] | None = None
if _TELLS_FROM <= _numbers(numba.__version__) < _TESTED[1]:
    fingerprint = getattr(_dispatcher, "compute_fingerprint", None)


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
        """Enter it under an object of its own, which cannot be called."""
        lowered = state["cr"]
        # Only machine code is handed its environment, by which it reaches Python; all code declares one.
        environment = state.targetctx.get_env_name(lowered.fndesc)
        if state.library.mentions(environment) > 1:
            raise NotImplementedError(f"{state.func_id.func_qualname} calls Python")
        # Numba takes built-in callables only here.  This one is new each time, and refuses all calls.
        entry: Any = {}.popitem
        state.targetctx.insert_user_function(entry, lowered.fndesc, [state.library])
        state["cr"] = lowered._replace(cfunc=entry)
        return True


# Numba's hash of flags is of their names, and so the same for all values.
_HASH = hash(Flags())


class _QuickFlags(Flags):  # type: ignore[misc]
    """Options of a compilation, which Numba compares whenever it searches for the code of an operator."""

    __slots__ = ()

    def __hash__(self) -> int:
        """Return Numba's hash, for which it lists and sorts all names."""
        return _HASH

    def __eq__(self, other: object) -> bool:
        """Compare what is set in either; Numba compares all that could be."""
        if not isinstance(other, Flags):
            return NotImplemented
        one, another = self._values, other._values
        return one == another or all(
            getattr(self, name) == getattr(other, name) for name in one.keys() | another.keys()
        )


class KernelCompiler(Compiler):  # type: ignore[misc]
    """Numba's steps to machine code; for the option `pipeline_class` of `numba.njit`."""

    def __init__(self, *args: Any) -> None:
        """Set Numba's compiler up, with options that are compared quickly."""
        super().__init__(*args)
        self.state.flags = _QuickFlags(self.state.flags)


class PartCompiler(KernelCompiler):
    """Numba's steps, as far as a part takes them; for the option `pipeline_class` of `numba.njit`."""

    noalias = False

    def define_pipelines(self) -> list[Any]:
        """Take the steps with the library of a part, and without machine code."""
        state = self.state
        state.library = _PartLibrary(state.targetctx.codegen(), state.func_id.func_qualname)
        state.flags.no_compile = True
        state.flags.noalias = self.noalias
        steps = DefaultPassBuilder.define_nopython_pipeline(state)
        steps.add_pass_after(_EnterPart, NativeLowering)
        steps.finalize()
        return [steps]


class SeparatePartCompiler(PartCompiler):
    """The same for a part whose arrays do not overlap, which LLVM is told."""

    noalias = True


def take_in(dispatcher: Any, part: Any) -> None:
    """Let compiled code that calls `dispatcher` take in `part`, which is compiled from the same source."""
    dispatcher.get_call_template = part.get_call_template
    dispatcher.get_overload = part.get_overload


# What a deferred kernel may return, by its annotation.
_RESULTS = {None: types.none, bool: types.boolean, int: types.int64, float: types.float64}


# Why kernels could not be compiled; the caller is told.
_FAILURES: list[BaseException] = []


class _FailureError(Exception):
    """What a module raises if it cannot have the address: making it raises the reason."""

    def __new__(cls) -> "_FailureError":
        """Raise what was raised when the kernel was compiled."""
        raise _FAILURES.pop() if _FAILURES else RuntimeError("a kernel could not be compiled")


@CFUNCTYPE(None, c_void_p, c_int64, c_void_p)  # type: ignore[untyped-decorator]
def _find_address(wanted: int, size: int, kept: int) -> None:
    """Write the address of what a module wants to call to a place in it, compiled now if it is not yet."""
    # No exception can pass through the code that asks: it raises one of its own.
    try:
        module, name, kinds, result = pickle.loads(string_at(wanted, size))  # noqa: S301 - our own code has it
        dispatcher = getattr(sys.modules[module], name).dispatcher
        dispatcher.compile(kinds)
        compiled = dispatcher.overloads[kinds]
        if types.unliteral(compiled.signature.return_type) != result:
            raise TypeError(
                f"{name} returns {compiled.signature.return_type}, and is annotated with {result}"
            )
        address = compiled.library.get_pointer_to_function(compiled.fndesc.llvm_func_name)
        c_void_p.from_address(kept).value = address
    except BaseException as error:  # noqa: BLE001 - anything that a compiler raises, and what stops it
        _FAILURES.append(error)


# Machine code on the disk knows the function by this name, in every process that loads it.
_ASK = "aimd_des_find_address"
binding.add_symbol(_ASK, cast(_find_address, c_void_p).value)


def _address(context: Any, builder: Any, name: str, wanted: bytes) -> Any:
    """Return the address of a deferred kernel, which the caller's module keeps from the first call on."""
    module, pointer, size = builder.module, cgutils.voidptr_t, ir.IntType(64)
    kept = cgutils.add_global_variable(module, pointer, module.get_unique_name(f"{name}_address"))
    kept.linkage, kept.initializer = "internal", ir.Constant(pointer, None)
    with cgutils.if_unlikely(builder, cgutils.is_null(builder, builder.load(kept))):
        text = ir.Constant(ir.ArrayType(ir.IntType(8), len(wanted)), bytearray(wanted))
        place = builder.bitcast(cgutils.global_constant(builder, f"{name}_wanted", text), pointer)
        kind = ir.FunctionType(ir.VoidType(), [pointer, size, pointer])
        ask = cgutils.get_or_insert_function(module, kind, _ASK)
        builder.call(ask, [place, ir.Constant(size, len(wanted)), builder.bitcast(kept, pointer)])
        with cgutils.if_unlikely(builder, cgutils.is_null(builder, builder.load(kept))):
            context.call_conv.return_user_exc(builder, _FailureError)
    return builder.load(kept)


def defer(dispatcher: Any) -> None:
    """Let compiled code call `dispatcher` by its address, and let it be compiled when that first happens."""
    function, key = dispatcher.py_func, object()
    name, result = function.__name__, _RESULTS[function.__annotations__["return"]]

    def get_call_template(args: Any, kws: Any) -> Any:
        """Tell what a call returns, by the annotation: nothing is compiled yet."""
        signature, kinds = dispatcher._compiler.fold_argument_types(args, kws)  # noqa: SLF001
        return make_concrete_template(name, key, [result(*kinds)]), signature, kinds, {}

    dispatcher.get_call_template = get_call_template
    dispatcher.get_overload = lambda signature: key

    @lower_builtin(key, types.VarArg(types.Any))  # type: ignore[untyped-decorator]
    def call(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        wanted = pickle.dumps((function.__module__, name, signature.args, result))
        convention, kinds = context.call_conv, (signature.return_type, signature.args)
        kind = convention.get_function_type(*kinds).as_pointer()
        code = builder.bitcast(_address(context, builder, name, wanted), kind)
        status, value = convention.call_function(builder, code, *kinds, args)
        with cgutils.if_unlikely(builder, status.is_error):
            convention.return_status_propagate(builder, status)
        return value
