"""What loops over rows in vector registers are made of: vectors out of arrays and back, and arithmetic on them.

Written for the compiler as it reads it (LLVM): from loops over arrays it makes code that stores and loads every number
in each row, at two to five times the cost. The compiler splits the vectors where the processor's own are shorter.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from llvmlite import ir
from numba import types
from numba.core import cgutils

from .lanes import HAS_FMA

LANES = 16  # numbers side by side
FLOAT, DOUBLE, INT = ir.FloatType(), ir.DoubleType(), ir.IntType(32)
VECTOR = ir.VectorType(FLOAT, LANES)
NONE = ir.Constant(VECTOR, ir.Undefined)


class Code:
    """The code of one loop, as it is written: arguments of the function, and what can be done with vectors."""

    def __init__(self, context: Any, builder: Any, signature: Any, values: Any) -> None:
        self.context, self.builder, self.signature, self.values = context, builder, signature, values

    def data(self, i: int) -> Any:
        """Where the numbers of argument i, an array, begin."""
        array = self.context.make_array(self.signature.args[i])
        return array(self.context, self.builder, value=self.values[i]).data

    def length(self, i: int) -> Any:
        """Numbers in a row of argument i, an array of rows."""
        array = self.context.make_array(self.signature.args[i])(self.context, self.builder, value=self.values[i])
        return cgutils.unpack_tuple(self.builder, array.shape, 2)[1]

    def numbers_of(self, i: int) -> list[Any]:
        """The numbers of argument i, a tuple."""
        return list(cgutils.unpack_tuple(self.builder, self.values[i]))

    def load(self, data: Any, index: Any) -> Any:
        return self.builder.load(self._at(data, index), align=4)

    def store(self, vector: Any, data: Any, index: Any) -> None:
        self.builder.store(vector, self._at(data, index), align=4)

    def number(self, data: Any, index: Any) -> Any:
        return self.builder.load(self.builder.gep(data, [index]))

    def _at(self, data: Any, index: Any) -> Any:
        return self.builder.bitcast(self.builder.gep(data, [index]), VECTOR.as_pointer())

    def everywhere(self, number: Any) -> Any:
        """A vector of which every number is this one."""
        one = self.builder.insert_element(NONE, number, INT(0))
        return self.builder.shuffle_vector(one, NONE, ir.Constant(ir.VectorType(INT, LANES), [INT(0)] * LANES))

    def fma(self, a: Any, b: Any, c: Any) -> Any:
        """a b + c; see `lanes.fma`."""
        if not HAS_FMA:
            return self.builder.fadd(self.builder.fmul(a, b), c)
        name = f"llvm.fma.v{LANES}f32"
        module = self.builder.module
        found = module.globals.get(name) or ir.Function(module, ir.FunctionType(VECTOR, [VECTOR] * 3), name)
        return self.builder.call(found, [a, b, c])

    def folded(self, vector: Any) -> Any:
        """The sum of the numbers of a vector, in double precision: the upper half onto the lower one, and again."""
        n = LANES
        while n > 1:
            n //= 2
            none = ir.Constant(vector.type, ir.Undefined)
            low, high = (ir.Constant(ir.VectorType(INT, n), [INT(k + i) for i in range(n)]) for k in (0, n))
            vector = self.builder.fadd(self.builder.shuffle_vector(vector, none, low),
                                       self.builder.shuffle_vector(vector, none, high))
        return self.builder.fpext(self.builder.extract_element(vector, INT(0)), DOUBLE)

    def rows(self, begin: Any, end: Any, step: int, carried: list[Any],
             body: Callable[[Any, list[Any]], list[Any]]) -> list[Any]:
        """Vectors `carried` after body(row, carried) of the rows from begin to end."""
        places = [cgutils.alloca_once_value(self.builder, v) for v in carried]
        for place, vector in zip(places, carried, strict=True):
            self.builder.store(vector, place)  # the place is made where the function begins, maybe outside a loop
        with cgutils.for_range_slice(self.builder, begin, end, ir.Constant(begin.type, step), begin.type) as (row, _):
            new = body(row, [self.builder.load(place) for place in places])
            for place, vector in zip(places, new, strict=True):
                self.builder.store(vector, place)
        return [self.builder.load(place) for place in places]


def is_plain(array: Any) -> bool:
    """Whether a type is that of an array of numbers in single precision without holes between them."""
    return isinstance(array, types.Array) and array.dtype is types.float32 and array.layout == "C"
