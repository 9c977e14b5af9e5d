"""Loops over rows in which sixteen numbers stay side by side in the processor's vector registers (see `vector_code`).

Sums and products come in the order written here, so the digits do not depend on how a caller was compiled (see
`lanes`).
"""

from __future__ import annotations

from typing import Any

import numba
from llvmlite import ir
from numba import types
from numba.extending import intrinsic
from numpy.typing import NDArray

from .vector_code import DOUBLE, FLOAT, INT, LANES, VECTOR, Code, is_plain

HIGHEST_TERM = 1e9


def _whiten_rows(typing: Any, T: Any, W: Any, low: Any, begin: Any, end: Any, a: Any, phi: Any, Z: Any) -> Any:
    """Replace rows begin to end of the columns T (rows, LANES) by their innovations over their deviation.

    W (5, numbers), from number `low` on: what an innovation adds to the prediction of the next state (z1, z2, load,
    s), and 1 / deviation. Z: the predicted states of each column, carried from row to row. All in single precision.
    """
    if not (is_plain(T) and is_plain(W) and is_plain(Z)):
        return None

    def code(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        c = Code(context, builder, signature, values)
        columns, weights, states = c.data(0), c.data(1), c.data(7)
        _, _, low, first, last, a_, phi_, _ = values
        length = c.length(1)
        number = first.type
        a = c.everywhere(a_)
        b = builder.fsub(c.everywhere(ir.Constant(FLOAT, 1.0)), a)
        ab, aa, phi = builder.fmul(a, b), builder.fmul(a, a), c.everywhere(phi_)
        phis = builder.fmul(phi, phi)

        def row(k: Any, state: list[Any]) -> list[Any]:
            z1, z2, load, s = state
            here = builder.mul(k, number(LANES))
            of_row = builder.add(low, k)
            k0, k1, k2, k3, scale = (
                c.everywhere(c.number(weights, builder.add(builder.mul(length, number(i)), of_row))) for i in range(5))
            e = builder.fsub(c.load(columns, here), z2)
            c.store(builder.fmul(e, scale), columns, here)
            return [c.fma(k0, e, c.fma(b, z1, builder.fmul(a, load))),
                    c.fma(k1, e, c.fma(ab, z1, c.fma(aa, load, builder.fmul(b, z2)))),
                    c.fma(k2, e, c.fma(phis, s, load)),
                    c.fma(k3, e, builder.fmul(phi, s))]

        lanes = [number(LANES * i) for i in range(4)]
        for vector, lane in zip(c.rows(first, last, 1, [c.load(states, lane) for lane in lanes], row), lanes,
                                strict=True):
            c.store(vector, states, lane)
        return context.get_dummy_value()

    return types.void(T, W, types.int64, types.int64, types.int64, types.float32, types.float32, Z), code


whiten_rows: Any = intrinsic(_whiten_rows)


def _products(typing: Any, E: Any, columns: Any, out: Any) -> Any:
    """Write to out the sums of the products of the rows E[columns[i]] and E[columns[k]], k = 0 to i, each i in turn.

    Of each row of E as many numbers are taken as fill vectors, the rest is left to the caller. E (rows, numbers) in
    single precision; columns: a tuple of whole numbers; out (pairs,) in double precision.
    """
    plain = isinstance(out, types.Array) and out.dtype is types.float64 and out.layout == "C"
    if not (is_plain(E) and plain and isinstance(columns, types.UniTuple)):
        return None

    def code(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        c = Code(context, builder, signature, values)
        numbers, sums = c.data(0), c.data(2)
        length = c.length(0)
        number = length.type
        starts = [builder.mul(k, length) for k in c.numbers_of(1)]
        pairs = [(i, k) for i in range(len(starts)) for k in range(i + 1)]
        whole = builder.and_(length, number(-LANES))

        def step(at: Any, totals: list[Any]) -> list[Any]:
            x = [c.load(numbers, builder.add(start, at)) for start in starts]
            return [c.fma(x[i], x[k], total) for (i, k), total in zip(pairs, totals, strict=True)]

        nothing = [ir.Constant(VECTOR, [FLOAT(0.0)] * LANES)] * len(pairs)
        for m, total in enumerate(c.rows(number(0), whole, LANES, nothing, step)):
            builder.store(c.folded(total), builder.gep(sums, [number(m)]))
        return context.get_dummy_value()

    return types.void(E, types.UniTuple(types.int64, columns.count), out), code


products: Any = intrinsic(_products)


@numba.njit(cache=True, nogil=True, error_model="numpy")
def sums_of_products(E: NDArray[Any], columns: Any, out: NDArray[Any]) -> None:
    """Write to out the sums of the products of the rows E[columns[i]] and E[columns[k]], k = 0 to i, each i in turn.

    E (rows, numbers) in single precision; columns: a tuple of whole numbers; out (pairs,) in double precision.
    """
    products(E, columns, out)
    n = E.shape[1]
    m = 0
    for i in range(len(columns)):
        x = E[columns[i]]
        for k in range(i + 1):
            y = E[columns[k]]
            for at in range(n - n % LANES, n):
                out[m] += x[at] * y[at]
            m += 1


def _columns_of(typing: Any, T: Any, rows: Any, E: Any, low: Any) -> Any:
    """Write the columns of T (rows, LANES) to the rows of E (LANES, numbers), from number `low` on.

    Of the first `rows` rows of T as many are taken as fill vectors, the rest is left to the caller. All in single
    precision.
    """
    if not (is_plain(T) and is_plain(E)):
        return None

    def code(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        c = Code(context, builder, signature, values)
        numbers, columns = c.data(0), c.data(2)
        length = c.length(2)
        number = length.type

        def square(begin: Any, carried: list[Any]) -> list[Any]:
            first = builder.mul(begin, number(LANES))
            v = [c.load(numbers, builder.add(first, number(LANES * i))) for i in range(LANES)]
            n = 1
            while n < LANES:  # swap squares of n by n beside the diagonal
                upper = [k if not k & n else LANES + k - n for k in range(LANES)]
                lower = [k + n if not k & n else LANES + k for k in range(LANES)]
                one, two = (ir.Constant(ir.VectorType(INT, LANES), [INT(k) for k in mask]) for mask in (upper, lower))
                for i in range(LANES):
                    if not i & n:
                        a, b = v[i], v[i + n]
                        v[i], v[i + n] = builder.shuffle_vector(a, b, one), builder.shuffle_vector(a, b, two)
                n *= 2
            at = builder.add(values[3], begin)
            for i in range(LANES):
                c.store(v[i], columns, builder.add(builder.mul(length, number(i)), at))
            return []

        c.rows(number(0), builder.and_(values[1], number(-LANES)), LANES, [], square)
        return context.get_dummy_value()

    return types.void(T, types.int64, E, types.int64), code


columns_of: Any = intrinsic(_columns_of)


def _grow(typing: Any, r: Any, begin: Any, end: Any, q: Any, side: Any) -> Any:
    """Multiply the numbers of side (LANES,) by 1 + q r^2, at most 1 + HIGHEST_TERM, of the numbers r from begin to end.

    end - begin: a multiple of LANES. r and q in single precision, side in double.
    """
    if not (is_plain(r) and isinstance(side, types.Array) and side.dtype is types.float64 and side.layout == "C"):
        return None

    def code(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        c = Code(context, builder, signature, values)
        numbers, out = c.data(0), c.data(4)
        factor, highest = c.everywhere(values[3]), c.everywhere(FLOAT(HIGHEST_TERM))
        wide = ir.VectorType(DOUBLE, LANES)
        ones = ir.Constant(wide, [DOUBLE(1.0)] * LANES)

        def step(at: Any, product: list[Any]) -> list[Any]:
            x = c.load(numbers, at)
            term = builder.fmul(builder.fmul(factor, x), x)
            term = builder.select(builder.fcmp_ordered("<", term, highest), term, highest)
            return [builder.fmul(product[0], builder.fadd(builder.fpext(term, wide), ones))]

        place = builder.bitcast(out, wide.as_pointer())
        [product] = c.rows(values[1], values[2], LANES, [builder.load(place, align=8)], step)
        builder.store(product, place, align=8)
        return context.get_dummy_value()

    return types.void(r, types.int64, types.int64, types.float32, side), code


grow: Any = intrinsic(_grow)
