"""What a reader of the sources can count on: short functions, short files, and numbers that say what they are."""

import ast
from collections.abc import Iterator
from pathlib import Path

SOURCE = Path(__file__).parent.parent / "src" / "lightprobe"
LONGEST_FUNCTION, LONGEST_FILE = 40, 300  # lines


def modules() -> Iterator[tuple[str, ast.Module, list[str]]]:
    """Yield path, syntax tree and lines of every file."""
    for path in sorted(SOURCE.rglob("*.py")):
        text = path.read_text()
        yield str(path.relative_to(SOURCE)), ast.parse(text), text.splitlines()


def is_number(value: ast.AST | None) -> bool:
    """Return whether an expression is made of written numbers alone."""
    match value:
        case ast.Constant():
            return isinstance(value.value, int | float) and not isinstance(value.value, bool)
        case ast.UnaryOp():
            return is_number(value.operand)
        case ast.BinOp():
            return is_number(value.left) and is_number(value.right)
        case ast.Tuple():
            return bool(value.elts) and all(is_number(each) for each in value.elts)
    return False


def explained(node: ast.AST, lines: list[str]) -> bool:
    """Return whether a comment stands on a statement's first line or above it, or a text below it."""
    above = lines[node.lineno - 2].lstrip() if node.lineno > 1 else ""
    below = lines[node.end_lineno].lstrip() if node.end_lineno < len(lines) else ""
    return "#" in lines[node.lineno - 1] or above.startswith("#") or below.startswith('"""')


def test_no_function_and_no_file_is_long():
    functions = (ast.FunctionDef, ast.AsyncFunctionDef)
    long = [name for name, _, lines in modules() if len(lines) > LONGEST_FILE]
    for name, tree, _ in modules():
        long += [
            f"{name}: {node.name}"
            for node in ast.walk(tree)
            if isinstance(node, functions) and node.end_lineno - node.lineno >= LONGEST_FUNCTION
        ]
    assert long == []


def test_every_number_that_a_module_names_is_explained():
    bare = [
        f"{name}: {lines[node.lineno - 1]}"
        for name, tree, lines in modules()
        for node in tree.body
        if isinstance(node, ast.Assign | ast.AnnAssign) and is_number(node.value) and not explained(node, lines)
    ]
    assert bare == []
