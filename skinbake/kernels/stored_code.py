"""Stored kernels run without what is needed only where kernels are compiled.

numba's own way fills its lists of functions and parses each kernel's bitcode: .4 s of a process that compiles nothing.
"""

from __future__ import annotations

from typing import Any

from llvmlite import binding as llvm
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import CompileResult
from numba.core.runtime import rtsys


class _Library(JITCodeLibrary):
    """A kernel's code: one that was stored has its bitcode parsed when a kernel is compiled that takes it in."""

    _stored: tuple[bytes, bytes] | None = None  # machine code and bitcode

    @classmethod
    def _unserialize(cls, codegen: Any, state: tuple[str, str, tuple[bytes, bytes]]) -> _Library:
        name, _, stored = state
        library = cls(codegen, name)
        library._stored = stored
        library.enable_object_caching()
        library._set_compiled_object(stored[0])
        library._finalize_final_module()
        return library

    def _get_module_for_linking(self) -> Any:
        if self._shared_module is None and self._stored:
            self._shared_module = llvm.parse_bitcode(self._stored[1])
        return super()._get_module_for_linking()

    def get_pointer_to_function(self, name: str) -> int:
        if self._stored and name.encode() in self._stored[0]:  # else there is none: LLVM would end the process
            return int(self._codegen._engine.get_function_address(name))
        return int(super().get_pointer_to_function(name))


def runnable(context: Any, stored: tuple[Any, ...]) -> Any:
    """The result of a compilation, from what `CompileResult._reduce` made of it.

    Parameters
    ----------
    context : CPUContext
        numba's.
    stored : tuple
    """
    rtsys.initialize(context)  # the symbols that machine code may ask for
    context.codegen()._library_class = _Library
    return CompileResult._rebuild(context, *stored)
