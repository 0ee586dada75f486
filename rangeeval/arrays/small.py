"""Algebra of the few-by-few matrices inside the kernels, written out: a library call costs more than the work."""

from __future__ import annotations

import math

from rangeeval.compiled import compiled


@compiled
def filled_up(count):  # type: ignore[no-untyped-def]
    """So many numbers filled up to whole vector registers: loops over them leave no remainder, which halves the time.

    What stands beyond the count is computed along and never used.
    """
    return (count + 7) & ~7


@compiled
def cholesky(a, n):  # type: ignore[no-untyped-def]
    """Overwrite the lower triangle of a Hermitian `a` by its factor, 1 / diagonal on the diagonal; False when not
    positive.
    """
    for j in range(n):
        left = a[j, j].real
        for k in range(j):
            left -= a[j, k].real * a[j, k].real + a[j, k].imag * a[j, k].imag
        if not left > 0.0:
            return False
        scale = 1.0 / math.sqrt(left)
        a[j, j] = scale
        for i in range(j + 1, n):
            total = a[i, j]
            for k in range(j):
                total -= a[i, k] * a[j, k].conjugate()
            a[i, j] = total * scale
    return True


@compiled
def forward(factor, n, b, columns):  # type: ignore[no-untyped-def]
    """Overwrite b (n, columns) by L^-1 b, L as `cholesky` leaves it."""
    for i in range(n):
        for k in range(i):
            left = factor[i, k]
            for c in range(columns):
                b[i, c] -= left * b[k, c]
        scale = factor[i, i].real
        for c in range(columns):
            b[i, c] *= scale


@compiled
def solve(a, n, b, columns):  # type: ignore[no-untyped-def]
    """Overwrite b (n, columns) by a^-1 b and spoil a: real, elimination with row exchange."""
    for j in range(n):
        best = j
        for i in range(j + 1, n):
            if abs(a[i, j]) > abs(a[best, j]):
                best = i
        if a[best, j] == 0.0:
            return False
        if best != j:
            for c in range(j, n):
                a[j, c], a[best, c] = a[best, c], a[j, c]
            for c in range(columns):
                b[j, c], b[best, c] = b[best, c], b[j, c]
        scale = 1.0 / a[j, j]
        for i in range(j + 1, n):
            factor = a[i, j] * scale
            if factor != 0.0:
                for c in range(j + 1, n):
                    a[i, c] -= factor * a[j, c]
                for c in range(columns):
                    b[i, c] -= factor * b[j, c]
    for j in range(n - 1, -1, -1):
        scale = 1.0 / a[j, j]
        for c in range(columns):
            total = b[j, c]
            for k in range(j + 1, n):
                total -= a[j, k] * b[k, c]
            b[j, c] = total * scale
    return True
