"""Symmetric positive systems as small as a particle: 2 x 2 and 3 x 3."""

import taichi as ti


@ti.func
def factorised(matrix, least, rounding):
    """L and D of ``matrix`` = L D L^T, in one: D on the diagonal, L below it.

    No pivot of a matrix that is at least ``least`` times the identity is smaller than that; one that is has drowned in
    rounding (``rounding`` [1], of the matrix's size), and is lifted, so that no noise is divided by next to nothing.
    """
    n = ti.static(matrix.n)
    floor = ti.max(least, rounding * matrix.trace())
    factor = matrix
    for j in ti.static(range(n)):
        pivot = matrix[j, j]
        for k in ti.static(range(j)):
            pivot -= factor[j, k] * factor[j, k] * factor[k, k]
        factor[j, j] = ti.max(pivot, floor)
        for i in ti.static(range(j + 1, n)):
            entry = matrix[i, j]
            for k in ti.static(range(j)):
                entry -= factor[i, k] * factor[j, k] * factor[k, k]
            factor[i, j] = entry / factor[j, j]
    return factor


@ti.func
def solved(factor, right):
    """x of L D L^T x = ``right``."""
    n = ti.static(right.n)
    x = right
    for i in ti.static(range(n)):
        for k in ti.static(range(i)):
            x[i] -= factor[i, k] * x[k]
    for i in ti.static(range(n)):
        x[i] /= factor[i, i]
    for row in ti.static(range(n)):
        i = ti.static(n - 1 - row)
        for k in ti.static(range(i + 1, n)):
            x[i] -= factor[k, i] * x[k]
    return x
