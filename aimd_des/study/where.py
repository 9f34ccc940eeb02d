"""Conditions over the axes of a study: read as an expression, checked node by node, never executed."""

import ast
import operator
from collections.abc import Callable, Mapping, Sequence
from difflib import get_close_matches
from typing import Any

from aimd_des.errors import InputError

__all__ = ["Condition"]

_COMPARED: dict[type[ast.cmpop], Callable[[Any, Any], bool]] = {
    ast.Eq: operator.eq,
    ast.NotEq: operator.ne,
    ast.Lt: operator.lt,
    ast.LtE: operator.le,
    ast.Gt: operator.gt,
    ast.GtE: operator.ge,
    ast.In: lambda one, several: one in several,
    ast.NotIn: lambda one, several: one not in several,
}
# No powers: 9**9**9 would keep a computer busy.
_COMPUTED: dict[type[ast.operator], Callable[[Any, Any], Any]] = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
    ast.Div: operator.truediv,
    ast.Mod: operator.mod,
}
_SIGNED: dict[type[ast.unaryop], Callable[[Any], Any]] = {
    ast.Not: operator.not_,
    ast.USub: operator.neg,
    ast.UAdd: operator.pos,
}
_ALLOWED = (
    "an expression of names of axes, numbers, strings in quotes, comparisons, and, or, not, in, + - * / % and"
    " parentheses"
)


class Condition:
    """A condition that points of a study must fulfil.

    Parameters
    ----------
    text : str
        Such as "latency <= 5 or loss < 0.5".
    names : sequence of str
        The axes, which may have dots in their names.

    Raises
    ------
    InputError
        If the text is no such expression, or names something that is no axis.
    """

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
            return
        operators: list[ast.AST] = []
        if isinstance(node, ast.Compare):
            operators, known = list(node.ops), set(_COMPARED)
        elif isinstance(node, ast.BinOp):
            operators, known = [node.op], set(_COMPUTED)
        elif isinstance(node, ast.UnaryOp):
            operators, known = [node.op], set(_SIGNED)
        elif isinstance(node, ast.Constant):
            operators, known = [], set()
            if not isinstance(node.value, bool | int | float | str):
                raise self._refused(node)
        elif isinstance(node, ast.BoolOp | ast.Tuple | ast.List):
            operators, known = [], set()
        else:
            raise self._refused(node)
        if any(type(one) not in known for one in operators):
            raise self._refused(node)
        for child in ast.iter_child_nodes(node):
            if isinstance(child, ast.expr):
                self._check(child)

    def _axis(self, node: ast.expr) -> str:
        name = ast.unparse(node)
        if name not in self._names:
            near = get_close_matches(name, self._names, n=1)
            hint = f"did you mean {near[0]!r}?" if near else ""
            known = ", ".join(self._names) or "there is none"
            raise InputError.of(f"name {name!r} in where", self.text, f"the name of an axis ({known})", hint)
        return name

    def _refused(self, node: ast.AST) -> InputError:
        return InputError.of(f"where has {ast.unparse(node)!r}, and where", self.text, _ALLOWED)

    def __call__(self, labels: Mapping[str, Any]) -> bool:
        """Tell whether a point fulfils the condition.

        Parameters
        ----------
        labels : mapping
            The value of each axis by its name.

        Returns
        -------
        bool
            Whether it does.

        Raises
        ------
        InputError
            If values cannot be compared or computed with, such as a word with a number.
        """
        try:
            return bool(self._value(self._root, labels))
        except (TypeError, ArithmeticError) as error:
            shown = ", ".join(f"{name} = {value!r}" for name, value in labels.items())
            raise InputError(f"where = {self.text!r}: cannot be computed at {shown} ({error})") from None

    def _value(self, node: ast.expr, labels: Mapping[str, Any]) -> Any:
        match node:
            case ast.Constant():
                return node.value
            case ast.Name() | ast.Attribute():
                return labels[self._axis(node)]
            case ast.BoolOp(op=ast.And()):
                return all(self._value(part, labels) for part in node.values)
            case ast.BoolOp():
                return any(self._value(part, labels) for part in node.values)
            case ast.UnaryOp():
                return _SIGNED[type(node.op)](self._value(node.operand, labels))
            case ast.BinOp():
                return _COMPUTED[type(node.op)](
                    self._value(node.left, labels), self._value(node.right, labels)
                )
            case ast.Compare():
                values = [self._value(part, labels) for part in (node.left, *node.comparators)]
                pairs = zip(node.ops, values, values[1:], strict=False)
                return all(_COMPARED[type(op)](one, other) for op, one, other in pairs)
            case ast.Tuple() | ast.List():
                return [self._value(part, labels) for part in node.elts]
        raise AssertionError(node)  # _check has seen to it
