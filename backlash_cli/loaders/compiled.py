"""How the parsers of text are compiled, and what they ask of the processor itself."""

from __future__ import annotations

from functools import partial
from typing import Any

import numba
from llvmlite import ir
from numba.core import types
from numba.extending import intrinsic

# Arrays are not counted on their way into functions (_nrt=False): that took longer than the parsing itself. So none
# of these functions may make an array.
compiled: Any = partial(numba.njit, cache=True, nogil=True, error_model="numpy", _nrt=False)
inlined: Any = partial(compiled, inline="always")
_of_processor: Any = intrinsic


@_of_processor
def word_at(_: Any, text: Any, at: Any) -> Any:
    """Eight bytes of memory from position `at` on as one uint64, the first one lowest; nobody looks at the bounds."""

    def load(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        array = context.make_array(signature.args[0])(context, builder, arguments[0])
        place = builder.bitcast(builder.gep(array.data, [arguments[1]]), ir.IntType(64).as_pointer())
        found = builder.load(place)
        found.align = 1
        return found

    return types.uint64(text, types.uint64), load


@_of_processor
def low_zeros(_: Any, word: Any) -> Any:
    """Number of zeros below the lowest one bit; 64 of nothing."""

    def count(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        return builder.cttz(arguments[0], ir.Constant(ir.IntType(1), 0))

    return types.uint64(types.uint64), count


@_of_processor
def bits_of(_: Any, number: Any) -> Any:
    """The bits of a float64 as uint64."""

    def cast(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        return builder.bitcast(arguments[0], ir.IntType(64))

    return types.uint64(types.float64), cast
