"""Conditions over the axes of a study: read as an expression, checked node by node, never executed."""

import ast
import operator
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from aimd_des.utils import validation
from aimd_des.utils.errors import InputError

# No powers: 9**9**9 would keep a computer busy.
_OPERATORS: dict[type[ast.AST], Callable[..., Any]] = {
    ast.Eq: operator.eq,
    ast.NotEq: operator.ne,
    ast.Lt: operator.lt,
    ast.LtE: operator.le,
    ast.Gt: operator.gt,
    ast.GtE: operator.ge,
    ast.In: lambda one, several: one in several,
    ast.NotIn: lambda one, several: one not in several,
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
    ast.Div: operator.truediv,
    ast.Mod: operator.mod,
    ast.Not: operator.not_,
    ast.USub: operator.neg,
    ast.UAdd: operator.pos,
    ast.And: all,
    ast.Or: any,
}
_NODES = (ast.Compare, ast.BinOp, ast.UnaryOp, ast.BoolOp, ast.Tuple, ast.List)
_ALLOWED = (
    "an expression of names of axes, numbers, strings in quotes, comparisons, and, or, not, in, + - * / % and"
    " parentheses"
)


class Condition:
    """A condition that points of a study must fulfil."""

    def __init__(self, text: str, names: Sequence[str]) -> None:
        self.text = text
        self._names = tuple(names)
        try:
            self._root = ast.parse(text.strip(), mode="eval").body
        except (SyntaxError, ValueError, RecursionError, MemoryError):
            raise InputError.of("where", text, _ALLOWED) from None
        self._check(self._root)

    def _check(self, node: ast.expr) -> None:
        """Refuse every node that is not on the list."""
        if isinstance(node, ast.Name | ast.Attribute):
            self._axis(node)
        elif isinstance(node, ast.Constant):
            if not isinstance(node.value, bool | int | float | str):
                raise self._refused(node)
        elif isinstance(node, _NODES):
            for child in ast.iter_child_nodes(node):
                if isinstance(child, ast.expr):
                    self._check(child)
                elif not isinstance(child, ast.expr_context) and type(child) not in _OPERATORS:
                    raise self._refused(node)
        else:
            raise self._refused(node)

    def _axis(self, node: ast.expr) -> str:
        name = ast.unparse(node)
        if name not in self._names:
            allowed = f"the name of an axis ({', '.join(self._names) or 'there is none'})"
            hint = validation.nearest(name, self._names)
            raise InputError.of(f"name {name!r} in where", self.text, allowed, hint)
        return name

    def _refused(self, node: ast.AST) -> InputError:
        return InputError.of(f"where has {ast.unparse(node)!r}, and where", self.text, _ALLOWED)

    def __call__(self, labels: Mapping[str, Any]) -> bool:
        """Tell whether a point fulfils the condition."""
        try:
            return bool(self._value(self._root, labels))
        except (TypeError, ArithmeticError) as error:
            shown = ", ".join(f"{name} = {value!r}" for name, value in labels.items())
            raise InputError(f"where = {self.text!r}: cannot be computed at {shown} ({error})") from None

    def _value(self, node: ast.expr, labels: Mapping[str, Any]) -> Any:
        if isinstance(node, ast.Name | ast.Attribute):
            return labels[self._axis(node)]
        if isinstance(node, ast.Constant):
            return node.value
        if isinstance(node, ast.BoolOp):
            # Lazily: what stands behind an "or" may be of no meaning where the first part holds.
            return _OPERATORS[type(node.op)](self._value(part, labels) for part in node.values)
        parts = [
            self._value(part, labels) for part in ast.iter_child_nodes(node) if isinstance(part, ast.expr)
        ]
        if isinstance(node, ast.BinOp | ast.UnaryOp):
            return _OPERATORS[type(node.op)](*parts)
        if isinstance(node, ast.Compare):
            pairs = zip(node.ops, parts, parts[1:], strict=False)
            return all(_OPERATORS[type(op)](one, other) for op, one, other in pairs)
        return parts
