"""Pages of the API: signatures with the type hints of the source, and Greek letters in docstrings.

Hints are short names, each a link where the API documents it.  Docstrings spell letters out, for terminals.
"""

import ast
import inspect
import re
import sys
import textwrap
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import Any, Literal, get_args, get_origin

from sphinx.application import Sphinx
from sphinx.util.typing import ExtensionMetadata

_API = Path(__file__).resolve().parents[1] / "api"
_DOCUMENTED = re.compile(r"^\.\. auto(?:class|exception):: +([\w.]+)$", re.MULTILINE)


@cache
def _addresses() -> dict[str, str]:
    """Where each class of the API is documented, by its short name."""
    pages = (path.read_text(encoding="utf-8") for path in sorted(_API.glob("*.rst")))
    names = [name for page in pages for name in _DOCUMENTED.findall(page)]
    return {name.rpartition(".")[2]: name for name in names}


class _Hint(ast.NodeTransformer):
    """Makes a hint readable: no modules, words in place of aliases for words, and links."""

    def __init__(self, module: str) -> None:
        self.names = vars(sys.modules[module])

    def visit_Constant(self, node: ast.Constant) -> ast.expr:
        """Read a hint in quotes, which names what is imported for type checkers alone."""
        if isinstance(node.value, str):
            return self.visit(ast.parse(node.value, mode="eval").body)
        return node

    def visit_Subscript(self, node: ast.Subscript) -> ast.expr:
        """Leave the words of a `Literal` as they are."""
        if ast.unparse(node.value) == "Literal":
            return node
        self.generic_visit(node)
        return node

    def visit_Attribute(self, node: ast.Attribute) -> ast.expr:
        """Name without its module."""
        return self.visit_Name(ast.Name(node.attr))

    def visit_Name(self, node: ast.Name) -> ast.expr:
        """Link a class that is documented; `~` shows its last part alone."""
        meaning = self.names.get(node.id)
        if get_origin(meaning) is Literal:
            return ast.parse(f"Literal[{', '.join(map(repr, get_args(meaning)))}]", mode="eval").body
        if node.id in _addresses() and (meaning is None or inspect.isclass(meaning)):
            return ast.UnaryOp(ast.Invert(), ast.parse(_addresses()[node.id], mode="eval").body)
        return ast.Name(node.id.lstrip("_"))


def _hint(node: ast.expr | None, module: str) -> str:
    return "" if node is None else ast.unparse(_Hint(module).visit(node))


def _definition(described: Any) -> ast.FunctionDef | ast.ClassDef | None:
    """Parse what defines a function or class; nothing where Python made it."""
    try:
        source = textwrap.dedent(inspect.getsource(described))
    except (OSError, TypeError):
        return None
    found = ast.parse(source).body[0]
    return found if isinstance(found, ast.FunctionDef | ast.ClassDef) else None


def _default(node: ast.expr | None, module: str) -> str:
    """Write a default as a call would: the value of a constant, what makes it where a field has a factory."""
    if isinstance(node, ast.Name):
        value = vars(sys.modules[module]).get(node.id)
        return repr(value) if isinstance(value, str | int | float) else node.id
    if not (isinstance(node, ast.Call) and ast.unparse(node.func) in {"field", "Field"}):
        return "" if node is None else ast.unparse(node)
    given = {keyword.arg: keyword.value for keyword in node.keywords}
    made = given.get("default_factory")
    if made is None:
        kept = given.get("default", node.args[0] if node.args else None)
        return "" if kept is None else ast.unparse(kept)
    factory = ast.unparse(made)
    empty = {"list": "[]", "dict": "{}"}
    return ast.unparse(made.body) if isinstance(made, ast.Lambda) else empty.get(factory, f"{factory}()")


def _fields(described: type) -> dict[str, tuple[str, str]]:
    """Find hint and default of each field that a class and its bases declare."""
    found: dict[str, tuple[str, str]] = {}
    for base in reversed(described.__mro__):
        definition = _definition(base)
        if base.__module__.split(".")[0] not in {"aimd_des", "models"} or definition is None:
            continue
        for node in definition.body:
            if isinstance(node, ast.AnnAssign) and isinstance(node.target, ast.Name):
                found[node.target.id] = (
                    _hint(node.annotation, base.__module__),
                    _default(node.value, base.__module__),
                )
    return found


def _arguments(definition: ast.FunctionDef, module: str) -> dict[str, tuple[str, str]]:
    """Find hint and default of each argument that a function declares."""
    given = definition.args
    by_place = [*given.posonlyargs, *given.args]
    padded = [None] * (len(by_place) - len(given.defaults)) + given.defaults
    named = [*zip(by_place, padded, strict=True), *zip(given.kwonlyargs, given.kw_defaults, strict=True)]
    named += [(rest, None) for rest in (given.vararg, given.kwarg) if rest]
    return {
        argument.arg: (_hint(argument.annotation, module), _default(default, module))
        for argument, default in named
    }


def _written(signature: inspect.Signature, known: dict[str, tuple[str, str]], skipped: int) -> Iterator[str]:
    """Write each parameter, and the star before those that go by name."""
    star = False
    for parameter in list(signature.parameters.values())[skipped:]:
        hint, default = known.get(parameter.name, ("", ""))
        if parameter.kind is parameter.VAR_POSITIONAL:
            star = True
        elif parameter.kind is parameter.KEYWORD_ONLY and not star:
            star = True
            yield "*"
        mark = {parameter.VAR_POSITIONAL: "*", parameter.VAR_KEYWORD: "**"}.get(parameter.kind, "")
        described = f"{mark}{parameter.name}" + (f": {hint}" if hint else "")
        yield described if parameter.default is parameter.empty else f"{described} = {default}"


def _of_class(described: type) -> str | None:
    """Write what a class is made of; nothing where the package makes its objects."""
    table = hasattr(described, "model_fields")
    if "Parameters\n" not in (described.__doc__ or "") and not table:
        return None
    made = _definition(None if table else vars(described).get("__init__"))
    of_function = isinstance(made, ast.FunctionDef)
    known = _arguments(made, described.__module__) if of_function else _fields(described)
    return f"({', '.join(_written(inspect.signature(described), known, 0))})"


def _of_function(described: Any) -> tuple[str, str]:
    """Write what a function or method takes, without `self`, and what it returns, if anything."""
    function = inspect.unwrap(getattr(described, "__func__", described))
    definition = _definition(function)
    if not isinstance(definition, ast.FunctionDef):
        return str(inspect.signature(function)), ""
    own = inspect.signature(function)
    skipped = next(iter(own.parameters), "") in {"self", "cls"}
    returned = _hint(definition.returns, function.__module__)
    written = ", ".join(_written(own, _arguments(definition, function.__module__), skipped))
    return f"({written})", "" if returned == "None" else returned


def signature(what: str, described: Any) -> tuple[str, str]:
    """Arguments in parentheses and what is returned; empty where users do not call what is described."""
    if what in {"function", "method"}:
        return _of_function(described)
    return (_of_class(described) or "", "") if what == "class" else ("", "")


def _replace(
    _app: Sphinx,
    what: str,
    _name: str,
    described: Any,
    _options: object,
    _args: str | None,
    _result: str | None,
) -> tuple[str, str] | None:
    return signature(what, described) if what in {"class", "function", "method"} else None


_GREEK = re.compile(
    r"(?<![^\s'\"(\[{</:-])(alpha|beta|gamma|Gamma|kappa|lambda|mu|nu|rho|sigma|tau|theta)(?:_(\w+))?"
    r"(?=[\s'\")\]}>\-/:.,;!?]|$)"
)
_CODE = re.compile(r"(`+[^`]*`+)")
_FIELD = re.compile(r"\s*[\w*]+(?:, [\w*]+)* : ")


def _letter(match: re.Match[str]) -> str:
    name, index = match.groups()
    return f":math:`\\{name}_{{{index}}}`" if index else f":math:`\\{name}`"


def _spell(lines: list[str]) -> list[str]:
    """Write names of Greek letters as letters in prose: not in code, blocks and names of parameters."""
    spelled, block = [], -1  # the indentation of what a block hangs from; -1 outside blocks
    for line in lines:
        text = line.lstrip()
        depth = len(line) - len(text)
        inside = block >= 0 and (not text or depth > block)
        block = block if inside else depth if text.endswith("::") or text.startswith(".. ") else -1
        if inside or block >= 0 or _FIELD.match(line) or text.startswith(">>>"):
            spelled.append(line)
        else:
            parts = _CODE.split(line)
            parts[::2] = [_GREEK.sub(_letter, part) for part in parts[::2]]
            spelled.append("".join(parts))
    return spelled


def _greek(_app: Sphinx, _what: str, _name: str, _obj: object, _options: object, lines: list[str]) -> None:
    lines[:] = _spell(lines)


def setup(app: Sphinx) -> ExtensionMetadata:
    """Write signatures; Sphinx's own would spell every alias out."""
    app.connect("autodoc-process-signature", _replace)
    app.connect("autodoc-process-docstring", _greek, priority=50)  # before Napoleon reads the sections
    return {"parallel_read_safe": True, "parallel_write_safe": True}
