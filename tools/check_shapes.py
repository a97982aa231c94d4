"""Say which public functions take or return tensors or arrays without naming their shapes.

    python tools/check_shapes.py [FOLDER ...]

Looks, without importing anything, at every public function and method, one without a leading underscore in
its own name, its class's or its module's, of which a parameter or the result is annotated as `Tensor` or
`ndarray`; a dict of tensors by name, which have no shape in common, does not count. Its docstring must do one
of three things:

- name a shape: `(P, 3)`, `(6, R, R, 3)`, `(N,)`, `[..., 3]`, `()` for a single number, or say that any shape
  will do;
- point to where the shapes stand: "as `X`", "as in `X`" or "like `X`", X being a dataclass, a function or an
  argument;
- be that of a property that only returns something and whose class names shapes.

Prints one line for each function that does none of them, and ends with 1 when there is one.
"""

import argparse
import ast
import re
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path

KINDS = ("Tensor", "ndarray")
NAMED = frozenset({"dict", "Mapping", "MutableMapping", "Callable"})  # hold many, or will make one
_SIZE = r"(?:\d+|\d*[A-Za-z_][\w.]*|\([^()]+\))"  # 3, 2H, rows, (R + 1)
_TERM = rf"(?:\d+ )?{_SIZE}"  # 6 R
_ITEM = rf"(?:\.\.\.|\*[\w.]+|{_TERM}(?: ?[-+*/^|] ?{_TERM})*)"  # ..., *index.shape, 6 (R + 1)^2, 1 | 3
_SHAPE = re.compile(rf"[(\[](?:|\.\.\.|{_ITEM},|{_ITEM}(?:, {_ITEM})+)[)\]]|\bany (?:one )?shape\b")
_POINTER = re.compile(r"\b(?:as|like)(?: in| for| from)?\s+`[\w.]+`")
_FOLDER = Path(__file__).parents[1] / "src" / "lightprobe"

Function = ast.FunctionDef | ast.AsyncFunctionDef


def names_shapes(docstring: str) -> bool:
    """Tell whether a docstring names a shape, or points to where it stands."""
    text = " ".join(docstring.split())
    return bool(_SHAPE.search(text) or _POINTER.search(text))


def unnamed(path: Path) -> Iterator[tuple[int, str]]:
    """Yield line and name of the public functions of a module that should name shapes and do not."""
    tree = ast.parse(path.read_text(encoding="utf-8"), str(path))
    for function, owner in _public_functions(tree):
        if not _has_arrays(function) or names_shapes(ast.get_docstring(function) or ""):
            continue
        if owner is not None and _is_plain_property(function) and names_shapes(_documentation(owner, path)):
            continue
        yield function.lineno, function.name if owner is None else f"{owner.name}.{function.name}"


def modules(folder: Path) -> Iterator[Path]:
    """Yield the public modules of a folder, in order of their names."""
    for path in sorted(folder.rglob("*.py")):
        names = path.relative_to(folder).with_suffix("").parts
        if not any(name.startswith("_") and name != "__init__" for name in names):
            yield path


def _public_functions(tree: ast.Module) -> Iterator[tuple[Function, ast.ClassDef | None]]:
    """Yield the functions of a module and the methods of its classes, each with its class."""
    for node in tree.body:
        if isinstance(node, Function) and not node.name.startswith("_"):
            yield node, None
        elif isinstance(node, ast.ClassDef) and not node.name.startswith("_"):
            for member in node.body:
                if isinstance(member, Function) and not member.name.startswith("_"):
                    yield member, node


def _has_arrays(function: Function) -> bool:
    """Tell whether an annotation of the function, quoted or not, mentions a tensor or an array."""
    given = function.args
    arguments = (*given.posonlyargs, *given.args, *given.kwonlyargs, given.vararg, given.kwarg)
    annotations = [argument.annotation for argument in arguments if argument is not None]
    return any(
        _mentions(annotation) for annotation in (*annotations, function.returns) if annotation is not None
    )


def _mentions(annotation: ast.AST) -> bool:
    """Tell whether an annotation is, or holds, a tensor or an array that has one shape."""
    if isinstance(annotation, ast.Subscript) and ast.unparse(annotation.value) in NAMED:
        return False
    words = [annotation.value] if isinstance(annotation, ast.Constant) else []
    words += [annotation.id] if isinstance(annotation, ast.Name) else []
    words += [annotation.attr] if isinstance(annotation, ast.Attribute) else []
    if any(re.search(rf"\b{kind}\b", str(word)) for kind in KINDS for word in words):
        return True
    return any(_mentions(part) for part in ast.iter_child_nodes(annotation))


def _is_plain_property(function: Function) -> bool:
    decorators = {ast.unparse(decorator) for decorator in function.decorator_list}
    body = [node for node in function.body if not isinstance(node, ast.Expr)]
    return bool(decorators & {"property", "functools.cached_property"}) and [type(node) for node in body] == [
        ast.Return
    ]


def _documentation(owner: ast.ClassDef, path: Path) -> str:
    """Return the docstring of a class and the comments behind its fields."""
    lines = path.read_text(encoding="utf-8").splitlines()
    fields = [lines[node.lineno - 1] for node in owner.body if isinstance(node, ast.AnnAssign)]
    return "\n".join([ast.get_docstring(owner) or "", *(line.partition("#")[2] for line in fields)])


def main(arguments: Sequence[str] | None = None) -> int:
    """Check the folders named in the arguments; return 1 when a function does not name its shapes."""
    parser = argparse.ArgumentParser(
        description="Say which public functions on tensors or arrays name no shapes."
    )
    parser.add_argument(
        "folders", nargs="*", type=Path, default=[_FOLDER], help="where to look; src/lightprobe"
    )
    found = 0
    for folder in parser.parse_args(arguments).folders:
        for path in modules(folder):
            for line, name in unnamed(path):
                print(f"{path}:{line}: {name} takes or returns tensors or arrays and names no shape.")
                found += 1
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main())
