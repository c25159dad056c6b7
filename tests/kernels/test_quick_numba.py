import importlib

import pytest
from numba.core import ir
from numba.core.compiler import Flags, run_frontend
from numba.core.targetconfig import TargetConfig

from skinbake.kernels import quick_numba

importlib.import_module("skinbake.kernels.compile")  # installs them


def several(a, b):
    total = 0.0
    for i in range(len(a)):
        total += a[i] * b[i, 0] if i % 2 else max(a[i], b[i, 1], *(1.0, 2.0))
    return {"total": total, "both": [a, b]}


def numbas_own(instruction, value):
    """As numba has it."""
    if isinstance(value, ir.Var):
        return [value]
    if isinstance(value, ir.Inst):
        return value.list_vars()
    if isinstance(value, (list, tuple)):
        return [found for part in value for found in numbas_own(instruction, part)]
    if isinstance(value, dict):
        return [found for part in value.values() for found in numbas_own(instruction, part)]
    return []


def test_variables_of_each_instruction_are_those_that_numba_lists(monkeypatch):
    """Loops, calls, items, lists and dictionaries; the same objects in the same order."""
    statements = [each for block in run_frontend(several).blocks.values() for each in block.body]
    quick = [each.list_vars() for each in statements]
    assert ir.Inst._rec_list_vars is quick_numba.variables_in
    monkeypatch.setattr(ir.Inst, "_rec_list_vars", numbas_own)
    slow = [each.list_vars() for each in statements]
    assert sum(map(len, slow)) > 40
    assert [list(map(id, found)) for found in quick] == [list(map(id, found)) for found in slow]


@pytest.mark.parametrize("changed", [{}, {"nrt": True}, {"error_model": "numpy", "noalias": True}])
def test_flags_have_the_values_that_were_set(changed):
    """Every option is there, and flags that differ in one are not equal."""
    flags = Flags()
    for name, value in changed.items():
        setattr(flags, name, value)
    assert TargetConfig.values is quick_numba.flag_values
    assert list(flags.values().items()) == [(name, getattr(flags, name)) for name in flags.options]
    other = flags.copy()
    assert flags == other
    assert hash(flags) == hash(other)
    other.release_gil = True
    assert flags != other
