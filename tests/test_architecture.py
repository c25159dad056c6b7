"""The folders are the data flow: what stands on the left never knows what stands on the right."""

import ast
import subprocess
import sys

import pytest

from tests.conftest import ROOT

ORDER = [
    "errors",
    "interrupt",
    "progress",
    "install",
    "numerics",
    "machine",
    "kernels",
    "stored_precision",
    "bilinear",
    "scene",
    "profile",
    "atlas",
    "irradiance",
    "transport",
    "diffuse",
    "relight",
    "pipeline",
    "compare",
    "tradeoff",
    "preview",
    "io",
    "page",
    "baking",
    "api",
    "export",
    "batch",
    "watch",
    "cli",
]
FILES = sorted((ROOT / "skinbake").rglob("*.py"))


def place(module: str) -> int:
    """Where a module of the package stands in the order; the package itself and its __main__ may know everything."""
    parts = module.split(".")
    return ORDER.index(parts[1]) if len(parts) > 1 and parts[1] in ORDER else len(ORDER)


@pytest.mark.parametrize("file", FILES, ids=lambda file: file.relative_to(ROOT).as_posix())
def test_no_module_imports_from_its_right(file):
    """Baking cannot reach the GPU or the disk; only `cli` joins everything."""
    here = ".".join(file.relative_to(ROOT).with_suffix("").parts)
    imported = set()
    for node in ast.walk(ast.parse(file.read_text())):
        if isinstance(node, ast.ImportFrom) and node.module and node.module.startswith("skinbake"):
            imported |= {node.module} if node.module != "skinbake" else {f"skinbake.{a.name}" for a in node.names}
        elif isinstance(node, ast.Import):
            imported |= {a.name for a in node.names if a.name.startswith("skinbake.")}
    too_far = [name for name in imported if name != "skinbake.__version__" and place(name) > place(here)]
    assert not too_far


def test_every_part_has_its_place():
    """A new folder or file at the top of the package must be given a place in the order."""
    found = {p.stem for p in (ROOT / "skinbake").iterdir() if p.suffix in ("", ".py") and not p.name.startswith("__")}
    assert found - {"REFERENCES", "docs"} == set(ORDER)


def test_help_imports_nothing_heavy():
    """`skinbake --help` answers at once: libraries are imported by the verb that needs them."""
    code = "import sys, skinbake.cli as c; c.run(['--help']); print(*sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=ROOT)
    loaded = set(done.stdout.splitlines()[-1].split())
    assert "click" in loaded
    assert not loaded & {
        "numpy",
        "scipy",
        "numba",
        "pydantic",
        "yaml",
        "matplotlib",
        "trimesh",
        "OpenEXR",
        "pyrender",
        "rich",
    }


def test_kernels_are_compiled_in_one_way():
    """`skinbake.kernels.compile.kernel` alone calls numba's compiler: what it does not know is not kept by content."""
    alone = ROOT / "skinbake" / "kernels" / "compile.py"
    assert [file for file in FILES if file != alone and "njit" in file.read_text()] == []


def test_numba_s_and_llvm_s_insides_are_known_in_one_folder():
    """What a new version of either may change is in `skinbake.kernels` alone."""
    found = []
    for file in FILES:
        for node in ast.walk(ast.parse(file.read_text())):
            names = [node.module or ""] if isinstance(node, ast.ImportFrom) else []
            names = [alias.name for alias in node.names] if isinstance(node, ast.Import) else names
            if any(name.split(".")[0] in ("numba", "llvmlite") for name in names):
                found.append(file)
    assert found
    assert {file.parent for file in found} == {ROOT / "skinbake" / "kernels"}


def test_kernels_take_seven_arguments_at_most():
    """What belongs together is a named tuple: a call of fifteen arrays in a row cannot be read, nor put in order."""
    kernels, long = 0, []
    for file in FILES:
        for node in ast.walk(ast.parse(file.read_text())):
            if not isinstance(node, ast.FunctionDef):
                continue
            names = [ast.unparse(d.func if isinstance(d, ast.Call) else d) for d in node.decorator_list]
            if "kernel" not in names:
                continue
            kernels += 1
            if len(node.args.posonlyargs + node.args.args + node.args.kwonlyargs) > 7:
                long.append(f"{file.relative_to(ROOT / 'skinbake').as_posix()}:{node.name}")
    assert kernels > 100
    assert long == []
