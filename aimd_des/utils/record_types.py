"""What Numba is taught of records, which `records` describes; it is imported when Numba is."""

from hashlib import sha256
from typing import Any

import numba
from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.core.imputils import impl_ret_borrowed
from numba.core.typing.templates import AttributeTemplate
from numba.core.typing.typeof import typeof, typeof_impl
from numba.extending import NativeValue, infer_getattr, lower_getattr_generic, models, register_model, unbox


class _Record(types.Type):  # type: ignore[misc]  # numba has no type information
    """The type of a record, by the types of its fields."""

    def __init__(self, cls: Any, kinds: tuple[Any, ...]) -> None:
        self.cls, self.names, self.kinds = cls, cls._fields, kinds
        super().__init__(name=f"{cls.__name__}({', '.join(map(str, kinds))})")

    @property
    def mangling_args(self) -> tuple[str, tuple[Any, ...]]:
        """A short name: it stands in every symbol of compiled code."""
        return f"{self.cls.__name__}{sha256(self.name.encode()).hexdigest()[:8]}", ()


def _structure(manager: Any, kind: _Record) -> Any:
    """Return the structure of a record in memory."""
    fields = [
        _structure(manager, field) if isinstance(field, _Record) else manager.lookup(field).get_value_type()
        for field in kind.kinds
    ]
    return ir.LiteralStructType(fields)


@register_model(_Record)
class _RecordModel(models.PrimitiveModel):  # type: ignore[misc]
    """A record is the address of its structure."""

    def __init__(self, manager: Any, kind: _Record) -> None:
        super().__init__(manager, kind, _structure(manager, kind).as_pointer())


@infer_getattr
class _RecordAttributes(AttributeTemplate):  # type: ignore[misc]
    """The types of fields."""

    key = _Record

    def generic_resolve(self, kind: _Record, name: str) -> Any:
        """Return the type of a field; None if there is none of this name."""
        return kind.kinds[kind.names.index(name)] if name in kind.names else None


def _load(builder: Any, address: Any) -> Any:
    """Load a value number by number, so that what is not used of an array is not loaded."""
    kind = address.type.pointee
    if isinstance(kind, ir.LiteralStructType | ir.ArrayType):
        value = ir.Constant(kind, ir.Undefined)
        for place in range(len(kind.elements) if isinstance(kind, ir.LiteralStructType) else kind.count):
            part = _load(builder, cgutils.gep_inbounds(builder, address, 0, place))
            value = builder.insert_value(value, part, place)
        return value
    value = builder.load(address)
    # A record never changes while compiled code runs, though its arrays may: without this promise
    # all would be loaded again after every store.
    value.set_metadata("invariant.load", builder.module.add_metadata([]))
    return value


@lower_getattr_generic(_Record)  # type: ignore[untyped-decorator]
def _field(context: Any, builder: Any, kind: _Record, value: Any, name: str) -> Any:
    place = kind.names.index(name)
    address = cgutils.gep_inbounds(builder, value, 0, place)
    if isinstance(kind.kinds[place], _Record):
        return address
    return impl_ret_borrowed(context, builder, kind.kinds[place], _load(builder, address))


def _filler(kind: Any, c: Any) -> Any:
    """Return a module's function that writes an array into a structure and tells whether it failed."""
    # What Numba makes of an array is long, and a kernel takes a hundred: one copy serves all of a type.
    name = f"aimd_des_fill_{sha256(str(kind).encode()).hexdigest()[:8]}"
    module = c.builder.module
    if name in module.globals:
        return module.globals[name]
    address = c.context.get_value_type(kind).as_pointer()
    function = ir.Function(module, ir.FunctionType(cgutils.bool_t, [c.pyapi.pyobj, address]), name)
    function.linkage = "internal"
    function.attributes.add("noinline")
    builder = ir.IRBuilder(function.append_basic_block("entry"))
    array, address = function.args
    native = c.context.get_python_api(builder).to_native_value(kind, array)
    builder.store(native.value, address)
    builder.ret(native.is_error)
    return function


def _fill(kind: _Record, record: Any, address: Any, c: Any, failed: Any) -> None:
    """Write the fields of a tuple of Python into a structure."""
    builder = c.builder
    for place, field in enumerate(kind.kinds):
        item = c.pyapi.tuple_getitem(record, place)
        target = cgutils.gep_inbounds(builder, address, 0, place)
        if isinstance(field, _Record):
            _fill(field, item, target, c, failed)
            continue
        if isinstance(field, types.Array):
            is_error = builder.call(_filler(field, c), [item, target])
        else:
            native = c.unbox(field, item)
            builder.store(native.value, target)
            is_error = native.is_error
        builder.store(builder.or_(builder.load(failed), is_error), failed)


@unbox(_Record)  # type: ignore[untyped-decorator]
def _unbox(kind: _Record, record: Any, c: Any) -> Any:
    """Put the structure where the call from Python keeps its variables: it lasts as long as the call."""
    failed = cgutils.alloca_once_value(c.builder, cgutils.false_bit)
    address = cgutils.alloca_once(c.builder, c.context.get_value_type(kind).pointee)
    _fill(kind, record, address, c, failed)
    # Fields are promised to be invariant, which holds from here on alone. Where LLVM follows the address into
    # the kernel, it may load them before they are filled: it must not know that this address is the same.
    known = ir.FunctionType(address.type, [address.type])
    hidden = c.builder.asm(known, "", "=r,0,~{memory}", [address], side_effect=True)
    return NativeValue(hidden, is_error=c.builder.load(failed))


def enter_record(cls: Any) -> None:
    """Let compiled code take a named tuple as one pointer."""
    if not numba.config.DISABLE_JIT:

        @typeof_impl.register(cls)  # type: ignore[untyped-decorator]
        def _(value: Any, context: Any) -> _Record:  # noqa: ARG001 - numba's calling convention
            return _Record(cls, tuple(map(typeof, value)))
