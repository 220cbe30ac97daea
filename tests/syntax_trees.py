"""Syntax trees of modules, which tests of the architecture and the language read: parsed once in a process."""

import ast
from functools import cache
from pathlib import Path


@cache
def parsed(path: Path) -> ast.Module:
    """Returns the syntax tree of a module."""
    return ast.parse(path.read_text("utf-8"))


@cache
def nodes_of(path: Path) -> list[ast.AST]:
    """Returns all nodes of the syntax tree of a module."""
    return list(ast.walk(parsed(path)))
