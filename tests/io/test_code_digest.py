"""Which code a result depends on."""

from __future__ import annotations

import pytest

from skinbake.io.code_digest import code_digest, code_modules, data_files, parse_source

STAGES = "skinbake.baking.stages"


def test_a_stage_hangs_on_what_it_imports():
    """Light through thin parts traces rays: lobes depend on the code of light, but light not on that of lobes."""
    diffuse, irradiance = code_modules(f"{STAGES}.diffuse"), code_modules(f"{STAGES}.irradiance")
    assert {"skinbake.irradiance.occluder", "skinbake.diffuse.terms.transmission", "skinbake.numerics"} <= diffuse
    assert "skinbake.irradiance.light_texels" in irradiance
    assert not any(name.startswith("skinbake.diffuse") for name in irradiance)
    assert not any(name.startswith("skinbake.preview") for name in diffuse | irradiance)
    for name in ("raster", "profile"):
        modules = code_modules(f"{STAGES}.{name}")
        assert not any(name.startswith(("skinbake.irradiance", "skinbake.diffuse")) for name in modules)


def test_shaders_are_code_of_the_picture():
    """They are read, not imported."""
    assert "skin.frag" in {path.name for path in data_files(f"{STAGES}.preview")}
    assert not data_files(f"{STAGES}.diffuse")


def test_prose_is_not_code():
    """Comments, docstrings and layout leave the digest; a changed number, name or string does not."""
    first = parse_source(b'"""Doc."""\ndef f(x):\n    """Of x."""\n    return x + 1  # one\n')
    same = parse_source(b'"""Other."""\n\n\n# a comment\ndef f(x):\n    return (x +\n        1)\n')
    assert first == same
    for other in (b"def f(x):\n    return x + 2\n", b"def f(x):\n    return x\n", b"def g(x):\n    return x + 1\n"):
        assert parse_source(other)[0] != first[0]


def test_imports_of_all_kinds_are_seen():
    """Inside functions and branches too; what only type checkers import is not run."""
    source = b"""
from typing import TYPE_CHECKING
import numpy
import skinbake.errors
from skinbake import numerics
if TYPE_CHECKING:
    from skinbake.never import Type
else:
    import skinbake.otherwise
def f():
    from skinbake.io.exr import write_parts
"""
    assert parse_source(source)[1] == [
        "skinbake", "skinbake.errors", "skinbake.io.exr", "skinbake.io.exr.write_parts", "skinbake.numerics",
        "skinbake.otherwise",
    ]  # fmt: skip


def test_a_module_that_is_not_there_is_refused():
    """Else its stage would hang on nothing."""
    with pytest.raises(ValueError, match=r"expected a module of skinbake, got skinbake\.nothing"):
        code_digest("skinbake.nothing")
