"""A C function, known by its address, called from inside a kernel.

The address is an argument, so that compiled code may be kept: in another run the library lies elsewhere.
"""

from __future__ import annotations

from typing import Any

from llvmlite import ir
from numba import types
from numba.extending import intrinsic


@intrinsic
def call_with_pointers(typing: Any, function: Any, first: Any, second: Any) -> Any:
    """Call `void function(void* first, void* second, NULL)`, all three given as integers.

    Parameters
    ----------
    function, first, second : int
        Addresses.
    """

    def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        byte = ir.IntType(8).as_pointer()
        of_type = ir.FunctionType(ir.VoidType(), [byte, byte, byte])
        target = builder.inttoptr(args[0], of_type.as_pointer())
        builder.call(target, [builder.inttoptr(args[1], byte), builder.inttoptr(args[2], byte), byte(None)])
        return context.get_dummy_value()

    return types.none(types.int64, types.int64, types.int64), generate
