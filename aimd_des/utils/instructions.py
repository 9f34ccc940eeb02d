"""What kernels do in place of some functions of Python, in fewer instructions or in some that have vectors.

Each is built here in LLVM's terms, under the name of the function that `jit.instruction` marks.  This module
imports Numba, and is imported by `jit` when Numba is taught.
"""

import operator
from collections.abc import Callable
from typing import Any

from llvmlite import ir
from numba import types
from numba.core.sigutils import normalize_signature
from numba.extending import lower_builtin, models, register_model, type_callable

_Build = Callable[[Any, Any, Any, Any], Any]

_REAL, _WORD, _WIDE = ir.DoubleType(), ir.IntType(64), ir.IntType(128)

# How many bits a fraction has.  The bits of its exponent are a whole number, 1022 for numbers from 1/2 to 1.
_BITS, _BIAS = 52, 1022
_SCALE = float(1 << _BITS)

# A number whose lowest bits are those of whole numbers that are added to it; less than half of it is lost.
_WHOLE = float(3 << 51)

# How many numbers are side by side, their type for LLVM, and the place of each.
_FOUR = 4
_ROW = ir.VectorType(_REAL, _FOUR)
_PLACES = [ir.Constant(ir.IntType(32), place) for place in range(_FOUR)]


class _Lanes(types.Type):  # type: ignore[misc]  # numba has no type information
    """The type of four numbers side by side."""


@register_model(_Lanes)
class _LanesModel(models.PrimitiveModel):  # type: ignore[misc]
    """Four numbers are a vector."""

    def __init__(self, manager: Any, kind: _Lanes) -> None:
        super().__init__(manager, kind, _ROW)


_LANES = _Lanes("Lanes")

# By the name of the function: what builds its instruction, and its signatures, of one argument or of two.
_BUILT: dict[str, tuple[_Build, tuple[Any, ...]]] = {}


def enter_instruction(function: Callable[..., Any]) -> None:
    """Let compiled code have an instruction in place of a function."""
    build, signatures = _BUILT[function.__name__.removeprefix("_")]
    _enter(function, signatures, build)


def _enter(function: Callable[..., Any], signatures: tuple[Any, ...], build: _Build) -> None:
    def chosen(*kinds: Any) -> Any:
        """Choose the signature for arguments; they are converted to those of the first if none has theirs."""
        return next((each for each in signatures if each.args == kinds), signatures[0])

    # Numba counts the parameters.
    def of_one(argument: Any) -> Any:
        return chosen(argument)

    def of_two(first: Any, second: Any) -> Any:
        return chosen(first, second)

    def of_four(first: Any, second: Any, third: Any, fourth: Any) -> Any:
        return chosen(first, second, third, fourth)

    typed = {1: of_one, 2: of_two, 4: of_four}[len(signatures[0].args)]
    type_callable(function)(lambda _context: typed)
    for signature in signatures:
        lower_builtin(function, *signature.args)(build)


def _built(*signatures: Any) -> Callable[[_Build], _Build]:
    def enter(build: _Build) -> _Build:
        _BUILT[build.__name__] = build, signatures
        return build

    return enter


# In bits alone, of which there are vectors; of conversions between words and numbers there are none.
@_built(types.UniTuple(types.float64, 2)(types.float64))
def split_normal(context: Any, builder: Any, signature: Any, args: Any) -> Any:
    """Split a normal number into its fraction and its exponent."""
    bits = builder.bitcast(args[0], _WORD)
    fraction = builder.and_(bits, ir.Constant(_WORD, (1 << _BITS) - 1))
    fraction = builder.or_(fraction, ir.Constant(_WORD, _BIAS << _BITS))
    # As the fraction of a number from 2**52 on, a whole number is added to it.
    exponent = builder.lshr(bits, ir.Constant(_WORD, _BITS))
    exponent = builder.or_(exponent, ir.Constant(_WORD, (1023 + _BITS) << _BITS))
    exponent = builder.fsub(builder.bitcast(exponent, _REAL), ir.Constant(_REAL, _SCALE + _BIAS))
    split = [builder.bitcast(fraction, _REAL), exponent]
    return context.make_tuple(builder, signature.return_type, split)


@_built(types.float64(types.float64))
def floor(_context: Any, builder: Any, _signature: Any, args: Any) -> Any:
    """Round a number down."""
    return builder.call(builder.module.declare_intrinsic("llvm.floor", [_REAL]), args)


@_built(types.float64(types.float64))
def power_of_two(_context: Any, builder: Any, _signature: Any, args: Any) -> Any:
    """Make a number of its exponent."""
    lowest = builder.bitcast(builder.fadd(args[0], ir.Constant(_REAL, _WHOLE + 1023.0)), _WORD)
    return builder.bitcast(builder.shl(lowest, ir.Constant(_WORD, _BITS)), _REAL)


@_built(types.UniTuple(types.uint64, 2)(types.uint64, types.uint64))
def multiply_wide(context: Any, builder: Any, signature: Any, args: Any) -> Any:
    """Multiply two words to the high and low word of their product."""
    product = builder.mul(builder.zext(args[0], _WIDE), builder.zext(args[1], _WIDE))
    high = builder.trunc(builder.lshr(product, ir.Constant(_WIDE, 64)), _WORD)
    return context.make_tuple(builder, signature.return_type, [high, builder.trunc(product, _WORD)])


@_built(types.int64(types.int64))
def highest_bit(_context: Any, builder: Any, _signature: Any, args: Any) -> Any:
    """Find the highest bit that is set: -1 of 0."""
    zeros = builder.ctlz(args[0], ir.Constant(ir.IntType(1), 0))
    return builder.sub(ir.Constant(_WORD, 63), zeros)


@_built(types.int64(types.float64))
def bits_of(_context: Any, builder: Any, _signature: Any, args: Any) -> Any:
    """Read the bits of a number, of +0.0 for both zeros."""
    return builder.bitcast(builder.fadd(args[0], ir.Constant(_REAL, 0.0)), _WORD)


@_built(types.float64(types.int64))
def time_of(_context: Any, builder: Any, _signature: Any, args: Any) -> Any:
    """Read the number that bits stand for."""
    return builder.bitcast(args[0], _REAL)


@_built(types.int64(types.int64), types.uint64(types.uint64))
def opaque(_context: Any, builder: Any, _signature: Any, args: Any) -> Any:
    """Hide a whole number from LLVM."""
    # Even empty assembly is left as it is: on every machine the number may become another.
    return builder.asm(ir.FunctionType(_WORD, [_WORD]), "", "=r,0", [args[0]], side_effect=True)


def _row_of(builder: Any, values: Any) -> Any:
    row = ir.Constant(_ROW, ir.Undefined)
    for value, place in zip(values, _PLACES, strict=True):
        row = builder.insert_element(row, value, place)
    return row


@_built(_LANES(*[types.float64] * _FOUR))
def four_lanes(_context: Any, builder: Any, _signature: Any, args: Any) -> Any:
    """Make a vector of four numbers."""
    return _row_of(builder, args)


@_built(types.UniTuple(types.float64, _FOUR)(_LANES))
def lanes_of(context: Any, builder: Any, signature: Any, args: Any) -> Any:
    """Take the numbers out of a vector."""
    return context.make_tuple(
        builder, signature.return_type, [builder.extract_element(args[0], place) for place in _PLACES]
    )


def _enter_operator(function: Callable[..., Any], name: str) -> None:
    """Let compiled code compute with vectors, and with a vector and a number, as with numbers."""

    def typed(first: Any, second: Any) -> Any:
        return _LANES if _LANES in (first, second) else None

    def build(_context: Any, builder: Any, _signature: Any, args: Any) -> Any:
        rows = [value if value.type == _ROW else _row_of(builder, [value] * _FOUR) for value in args]
        return getattr(builder, name)(*rows)

    type_callable(function)(lambda _context: typed)
    for kinds in ((_LANES, _LANES), (_LANES, types.float64), (types.float64, _LANES)):
        lower_builtin(function, *kinds)(build)


for _operator, _name in ((operator.add, "fadd"), (operator.sub, "fsub"), (operator.mul, "fmul")):
    _enter_operator(_operator, _name)


def enter_address(function: Callable[..., Any], signature: str) -> None:
    """Let compiled code call what is at an address, with a tuple of arguments, in place of a function."""
    kinds, returned = normalize_signature(signature)
    # Addresses travel as integers: a function pointer among a kernel's arguments would be part of its type,
    # and every function would compile the kernel anew.
    given = types.Tuple([types.int64 if isinstance(kind, types.CPointer) else kind for kind in kinds])

    def call(context: Any, builder: Any, _signature: Any, args: Any) -> Any:
        address, packed = args
        words = [context.get_value_type(kind) for kind in kinds]
        values = [builder.extract_value(packed, place) for place in range(len(kinds))]
        for place, kind in enumerate(kinds):
            if isinstance(kind, types.CPointer):
                values[place] = builder.inttoptr(values[place], words[place])
        gives = ir.VoidType() if returned == types.void else context.get_value_type(returned)
        found = builder.inttoptr(address, ir.FunctionType(gives, words).as_pointer())
        result = builder.call(found, values)
        return context.get_dummy_value() if returned == types.void else result

    _enter(function, (returned(types.int64, given),), call)
