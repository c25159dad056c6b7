"""Digest of the code that a module runs: its own and that of every module of the package it imports.

Found without importing anything, from the source: imports inside functions count, those for type checkers only do not.
Docstrings and comments are left out, so a stage whose prose was edited is not run again. Files that are not Python, as
shaders, count for every module of the folder of the package that they lie in.
"""

from __future__ import annotations

import ast
import hashlib
import json
import os
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import Any

from skinbake.errors import SkinbakeError
from skinbake.io.atomic import write_text

PACKAGE = Path(__file__).parent.parent
NAME = PACKAGE.name
_PARSED = PACKAGE / "__pycache__" / "code-digests.json"  # parsing all of the package takes a second
_NOT_CODE = {".py", ".pyc", ".md", ".bib"}


@cache
def code_digest(*modules: str) -> str:
    """Digest of modules, as `skinbake.atlas.rasterize`, and of all that they import.

    Raises
    ------
    ValueError
        There is no such module.
    """
    digest = hashlib.sha256()
    sources = _sources()
    for name in sorted(code_modules(*modules)):
        digest.update(f"{name}\0{sources[name][0]}\0".encode())
    for path in data_files(*modules):
        digest.update(path.relative_to(PACKAGE).as_posix().encode() + b"\0" + path.read_bytes())
    return digest.hexdigest()


@cache
def code_modules(*modules: str) -> frozenset[str]:
    """The modules and all that they import, of this package, by dotted name.

    Raises
    ------
    ValueError
        There is no such module.
    """
    sources = _sources()
    found: set[str] = set()
    todo = list(modules)
    for module in modules:
        if module not in sources:
            raise ValueError(f"code_modules: expected a module of {NAME}, got {module}")
    while todo:
        module = todo.pop()
        if module in found:
            continue
        found.add(module)
        parents = [module[:i] for i, letter in enumerate(module) if letter == "."]
        todo += [name for name in (*parents, *sources[module][1]) if name in sources and name not in found]
    return frozenset(found)


def data_files(*modules: str) -> list[Path]:
    """Files beside or below the code that `modules` run and that are not code themselves."""
    run = code_modules(*modules)
    return [path for path, folders in _data_files().items() if not run.isdisjoint(folders)]


@cache
def _data_files() -> dict[Path, list[str]]:
    """Files of the package that are not code, and the folders below it that each lies in, by dotted name."""
    folders = {path: path.relative_to(PACKAGE.parent).parts[:-1] for path in _files() if path.suffix not in _NOT_CODE}
    return {path: [".".join(parts[:end]) for end in range(2, len(parts) + 1)] for path, parts in folders.items()}


@cache
def _files() -> list[Path]:
    """Every file of the package, sorted."""
    found: list[Path] = []
    for folder, below, names in os.walk(PACKAGE):
        below[:] = [name for name in below if name != "__pycache__"]
        found += [Path(folder, name) for name in names]
    return sorted(found)


def _code_files() -> list[Path]:
    return [path for path in _files() if path.suffix == ".py"]


@cache
def package_digest() -> str:
    """Digest of every file of the package as it is, comments included."""
    digest = hashlib.sha256()
    for file in _code_files():
        digest.update(file.relative_to(PACKAGE).as_posix().encode() + b"\0" + file.read_bytes())
    return digest.hexdigest()


@cache
def _sources() -> dict[str, tuple[str, list[str]]]:
    """Digest and imports of each module by its dotted name; what was parsed before is remembered by content."""
    before = _parsed_before()
    sources, parsed = {}, {}
    for file in _code_files():
        parts = file.relative_to(PACKAGE.parent).with_suffix("").parts
        name = ".".join(parts[:-1] if parts[-1] == "__init__" else parts)
        content = file.read_bytes()
        key = hashlib.sha256(content).hexdigest()
        parsed[key] = before[key] if key in before else parse_source(content)
        sources[name] = parsed[key]
    if parsed.keys() - before.keys():
        with suppress(SkinbakeError, OSError):  # a package that cannot be written to is parsed each time
            write_text(_PARSED, json.dumps(parsed))
    return sources


def parse_source(content: bytes) -> tuple[str, list[str]]:
    """Digest of a source without comments and docstrings, and the names it imports of this package."""
    tree = ast.parse(content)
    imported = sorted(set(_imported(tree)))
    for node in ast.walk(tree):
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef):
            first = node.body[0] if node.body else None
            if isinstance(first, ast.Expr) and isinstance(first.value, ast.Constant) and type(first.value.value) is str:
                del node.body[0]
    return hashlib.sha256(ast.dump(tree).encode()).hexdigest(), imported


def _imported(node: ast.AST) -> list[str]:
    if isinstance(node, ast.Import):
        return [name.name for name in node.names if name.name.partition(".")[0] == NAME]
    if isinstance(node, ast.ImportFrom):
        ours = node.module is not None and node.module.partition(".")[0] == NAME
        return [str(node.module), *(f"{node.module}.{name.name}" for name in node.names)] if ours else []
    children = list(ast.iter_child_nodes(node))
    if isinstance(node, ast.If) and isinstance(node.test, ast.Name) and node.test.id == "TYPE_CHECKING":
        children = list(node.orelse)
    return [name for child in children for name in _imported(child)]


def _parsed_before() -> dict[str, tuple[str, list[str]]]:
    with suppress(OSError, ValueError, TypeError, RecursionError):
        record: Any = json.loads(_PARSED.read_text(encoding="utf-8"))
        return {str(key): (str(digest), [str(name) for name in names]) for key, (digest, names) in record.items()}
    return {}
