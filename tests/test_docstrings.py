"""Docstrings: the part of their rules that a machine can hold."""

import ast

import pytest

from tests.conftest import ROOT

PACKAGE = ROOT / "skinbake"
FILES = sorted(PACKAGE.rglob("*.py"))


def functions(tree, inside=False):
    """Every function of a tree, and whether it lies inside another one or a private class."""
    for node in ast.iter_child_nodes(tree):
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            yield node, inside
            yield from functions(node, True)
        else:
            yield from functions(node, inside or (isinstance(node, ast.ClassDef) and node.name.startswith("_")))


def decorators(function):
    """Names of a function's decorators, without their arguments."""
    return [ast.unparse(d.func if isinstance(d, ast.Call) else d) for d in function.decorator_list]


def parameters(function):
    """Names of the parameters that a caller fills."""
    a = function.args
    return [p.arg for p in (*a.posonlyargs, *a.args, *a.kwonlyargs) if p.arg not in ("self", "cls")]


def is_kernel(function):
    """Compiled by numba."""
    return any(name.split(".")[-1] in ("kernel", "njit") for name in decorators(function))


def is_public(function, inside):
    """Called from elsewhere. A verb is not: its docstring is the text of --help, and click tells each option."""
    verb = any(name.endswith((".command", ".group")) for name in decorators(function))
    return not (inside or function.name.startswith("_") or verb)


def needs_parameters(function, inside):
    """Public, and with three or more parameters to fill."""
    return is_public(function, inside) and len(parameters(function)) >= 3


def raises_by_itself(function):
    """Whether the body names an exception, inner functions aside."""
    inner = {node for child, _ in functions(function) for node in ast.walk(child)}
    return any(isinstance(node, ast.Raise) and node.exc for node in ast.walk(function) if node not in inner)


def test_the_rules_find_what_they_look_for():
    """Each rule, tried on code that breaks it."""
    source = "@kernel(inline=True)\ndef kernel(a, b, c):\n    def inner(a, b, c):\n        raise ValueError(a)\n"
    (kernel, outside), (inner, inside) = functions(ast.parse(source))
    assert (outside, inside) == (False, True)
    assert (is_kernel(kernel), is_kernel(inner)) == (True, False)
    assert (needs_parameters(kernel, outside), needs_parameters(inner, inside)) == (True, False)
    assert (raises_by_itself(kernel), raises_by_itself(inner)) == (False, True)


@pytest.mark.parametrize("file", FILES, ids=lambda file: file.relative_to(ROOT).as_posix())
def test_docstrings_keep_the_rules(file):
    """No docstring begins with "Of", kernels have one, public functions list what they take and what they raise."""
    tree, broken = ast.parse(file.read_text()), []
    for node in ast.walk(tree):
        documented = isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef)
        if documented and (ast.get_docstring(node) or "").startswith("Of "):
            broken.append(f'{getattr(node, "name", "module")}: begins with "Of"')
    for function, inside in functions(tree):
        text = ast.get_docstring(function) or ""
        if is_kernel(function) and not text:
            broken.append(f"{function.name}: a kernel without a docstring")
        if needs_parameters(function, inside) and "Parameters\n----" not in text:
            broken.append(f"{function.name}: {len(parameters(function))} parameters and no section Parameters")
        if is_public(function, inside) and raises_by_itself(function) and "Raises\n----" not in text:
            broken.append(f"{function.name}: raises and has no section Raises")
    assert broken == []
