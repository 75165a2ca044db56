"""Where a source file may be made faulty, and the file with one such fault."""

from __future__ import annotations

import ast
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import accumulate
from typing import Any

_TURNED = {
    ast.Lt: ast.GtE, ast.GtE: ast.Lt, ast.Gt: ast.LtE, ast.LtE: ast.Gt, ast.Eq: ast.NotEq,
    ast.NotEq: ast.Eq, ast.In: ast.NotIn, ast.NotIn: ast.In, ast.Is: ast.IsNot, ast.IsNot: ast.Is,
}  # fmt: skip
_OTHER = {ast.Add: ast.Sub, ast.Sub: ast.Add, ast.Mult: ast.Div, ast.Div: ast.Mult}


@dataclass(frozen=True)
class Site:
    """The `ordinal`-th place of a kind in a function or class: lines may move."""

    path: str
    within: str
    kind: str
    ordinal: int


def sites_of(path: str, text: str) -> Iterator[Site]:
    """All places of a file."""
    counts = Counter[tuple[str, str]]()
    for within, kind, _ in _places(ast.parse(text), ""):
        yield Site(path, within, kind, counts[within, kind])
        counts[within, kind] += 1


def faulty(text: str, site: Site) -> tuple[str, int, str]:
    """The file with that fault, the line where it stands, and the words for it."""
    places = _places(ast.parse(text), "")
    node = [node for *key, node in places if key == [site.within, site.kind]][site.ordinal]
    before, after = ast.unparse(node), ast.unparse(KINDS[site.kind](node))
    written = after if isinstance(node, ast.Return) else f"({after})"
    assert node.end_lineno is not None
    assert node.end_col_offset is not None
    raw = text.encode()  # columns count bytes
    starts = [0, *accumulate(map(len, raw.splitlines(keepends=True)))]
    start = starts[node.lineno - 1] + node.col_offset
    end = starts[node.end_lineno - 1] + node.end_col_offset
    changed = (raw[:start] + written.encode() + raw[end:]).decode()
    return changed, node.lineno, f"{before} -> {after}".replace("\n", " ")


def _places(node: ast.AST, within: str) -> Iterator[tuple[str, str, ast.expr | ast.Return]]:
    """Every node that can be made faulty; messages, hints and `__main__` are passed over."""
    if _is_apart(node):
        return
    yield from ((within, kind, place) for kind, place in _kinds(node))
    if isinstance(node, (ast.FunctionDef, ast.ClassDef)):
        within = f"{within}.{node.name}".lstrip(".")
    for child in _children(node):
        yield from _places(child, within)


def _children(node: ast.AST) -> Iterator[ast.AST]:
    if isinstance(node, (ast.Raise, ast.JoinedStr)):
        return
    for name, value in ast.iter_fields(node):
        if name not in ("annotation", "returns"):
            values: list[Any] = value if isinstance(value, list) else [value]
            yield from (child for child in values if isinstance(child, ast.AST))


def _is_apart(node: ast.AST) -> bool:
    apart = ("TYPE_CHECKING", "__name__ == '__main__'")
    return isinstance(node, ast.If) and ast.unparse(node.test) in apart


def _kinds(node: ast.AST) -> Iterator[tuple[str, ast.expr | ast.Return]]:
    if isinstance(node, ast.Compare):
        yield "comparison", node
    if isinstance(node, ast.BinOp) and type(node.op) in _OTHER and not _is_text(node):
        yield "arithmetic", node
    if isinstance(node, ast.Constant) and isinstance(node.value, (bool, int, float)):
        yield "constant", node
    if isinstance(node, (ast.If, ast.While, ast.IfExp)):
        yield "not", node.test
    if isinstance(node, ast.Return) and node.value and ast.unparse(node.value) != "None":
        yield "return", node


def _is_text(node: ast.BinOp) -> bool:
    return any(
        isinstance(side, ast.JoinedStr)
        or (isinstance(side, ast.Constant) and isinstance(side.value, (str, bytes)))
        for side in (node.left, node.right)
    )


def _compared(node: ast.Compare) -> ast.expr:
    return ast.Compare(node.left, [_TURNED[type(node.ops[0])](), *node.ops[1:]], node.comparators)


def _calculated(node: ast.BinOp) -> ast.expr:
    return ast.BinOp(node.left, _OTHER[type(node.op)](), node.right)


def _counted(node: ast.Constant) -> ast.expr:
    value: Any = node.value
    if isinstance(value, bool):
        return ast.Constant(not value)
    return ast.Constant(1.5 * value + 1 if isinstance(value, float) else value + 1)


def _turned(node: ast.expr) -> ast.expr:
    if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.Not):
        return node.operand
    return ast.UnaryOp(ast.Not(), node)


KINDS: dict[str, Callable[[Any], ast.AST]] = {
    "comparison": _compared,
    "arithmetic": _calculated,
    "constant": _counted,
    "not": _turned,
    "return": lambda _: ast.Return(None),
}
