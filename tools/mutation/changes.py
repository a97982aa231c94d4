"""The small changes that make mutants of a module's source."""

import ast
import copy
from collections.abc import Iterator
from dataclasses import dataclass

_COMPARISONS: dict[type[ast.cmpop], type[ast.cmpop]] = {
    ast.Lt: ast.LtE,
    ast.LtE: ast.Lt,
    ast.Gt: ast.GtE,
    ast.GtE: ast.Gt,
    ast.Eq: ast.NotEq,
    ast.NotEq: ast.Eq,
    ast.Is: ast.IsNot,
    ast.IsNot: ast.Is,
    ast.In: ast.NotIn,
    ast.NotIn: ast.In,
}
_OPERATORS: dict[type[ast.operator], type[ast.operator]] = {
    ast.Add: ast.Sub,
    ast.Sub: ast.Add,
    ast.Mult: ast.Div,
    ast.Div: ast.Mult,
    ast.FloorDiv: ast.Mult,
    ast.Mod: ast.Mult,
    ast.Pow: ast.Mult,
    ast.BitAnd: ast.BitOr,
    ast.BitOr: ast.BitAnd,
}
_STEPS = {
    "abs",
    "clamp",
    "clip",
    "cumsum",
    "exp",
    "flip",
    "log",
    "maximum",
    "minimum",
    "mean",
    "square",
    "sqrt",
}
_FACTOR = 1.5  # of numbers with a fraction


@dataclass(frozen=True)
class Change:
    """One mutant of a source text."""

    line: int
    before: str  # the changed expression
    after: str
    source: str  # all of the module

    def __str__(self) -> str:
        return f"`{_short(self.before)}` to `{_short(self.after)}`"


def changes(source: str) -> list[Change]:
    """Return all mutants of a module in the order of its text; annotations, docstrings and constants' names
    stay.
    """
    tree = ast.parse(source)
    found = []
    for path, node in _code(tree, ()):
        for new in _variants(node):
            mutant = copy.deepcopy(tree)
            _put(mutant, path, ast.copy_location(new, node))
            text = ast.unparse(ast.fix_missing_locations(mutant))
            found.append(Change(node.lineno, ast.unparse(node), ast.unparse(new), text))
    return sorted(found, key=lambda change: change.line)


Path = tuple[tuple[str, int | None], ...]  # fields, with the place in a list, from the root


def _code(node: ast.AST, path: Path) -> Iterator[tuple[Path, ast.expr]]:
    """Yield every expression that runs, and the way to it."""
    for name, value in ast.iter_fields(node):
        if name in ("annotation", "returns", "decorator_list", "type_params", "bases"):
            continue
        children = enumerate(value) if isinstance(value, list) else [(None, value)]
        for index, child in children:
            if not isinstance(child, ast.AST) or _is_text(child):
                continue
            way = (*path, (name, index))
            if isinstance(child, ast.expr):
                yield way, child
            yield from _code(child, way)


def _is_text(node: ast.AST) -> bool:
    """Return whether a statement is a docstring, or an expression is a text with values in it."""
    match node:
        case ast.Expr(value=ast.Constant(value=str())) | ast.JoinedStr():
            return True
    return False


def _variants(node: ast.expr) -> Iterator[ast.expr]:
    """Yield what an expression is changed to."""
    match node:
        case ast.Compare(ops=[one]) if type(one) in _COMPARISONS:
            yield ast.Compare(node.left, [_COMPARISONS[type(one)]()], node.comparators)
        case ast.BinOp() if type(node.op) in _OPERATORS:
            yield ast.BinOp(node.left, _OPERATORS[type(node.op)](), node.right)
        case ast.BoolOp():
            yield ast.BoolOp(ast.Or() if isinstance(node.op, ast.And) else ast.And(), node.values)
        case ast.UnaryOp(op=ast.Not() | ast.USub() | ast.Invert()):
            yield node.operand
        case ast.IfExp():
            yield ast.IfExp(node.test, node.orelse, node.body)
        case ast.Constant(value=bool() as value):
            yield ast.Constant(not value)
        case ast.Constant(value=int() as value):
            yield ast.Constant(value + 1)
        case ast.Constant(value=float() as value):
            yield ast.Constant(value * _FACTOR if value else 1.0)
        case ast.Call(func=ast.Attribute(attr=name, value=owner)) if name in _STEPS and not _is_library(
            owner
        ):
            yield owner


def _is_library(owner: ast.expr) -> bool:
    """Return whether a function's owner is a module, as in `torch.exp`, which is no value itself."""
    return ast.unparse(owner) in ("torch", "np", "math", "functional")


def _put(tree: ast.AST, path: Path, new: ast.expr) -> None:
    """Put an expression into its place."""
    owner: ast.AST = tree
    for name, index in path[:-1]:
        value = getattr(owner, name)
        owner = value if index is None else value[index]
    name, index = path[-1]
    if index is None:
        setattr(owner, name, new)
    else:
        getattr(owner, name)[index] = new


def _short(text: str) -> str:
    return text if len(text) <= 80 else text[:77] + "..."
