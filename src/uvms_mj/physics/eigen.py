r"""Eigenvalues of small symmetric matrices, by cyclic Jacobi rotations (Golub and Van Loan, "Matrix Computations",
2013, sec. 8.5).

A rotation in the plane of two axes p < q makes the entry a_pq zero. With :math:`\vartheta = (a_{qq} - a_{pp}) / (2
a_{pq})` its tangent is :math:`t = \pm 1 / (|\vartheta| + \sqrt{1 + \vartheta^2})`, with the sign of
:math:`\vartheta`. A sweep takes all pairs once. The other entries fall quadratically: four or five sweeps are enough
for matrices of 6 by 6.
"""

import math

from .kernels import kernel

SWEEPS = 20
"""Most sweeps; ten are enough for matrices up to 36 by 36."""
NEGLIGIBLE = 1e-15
"""An entry off the diagonal is negligible below this share of the largest one on it, at the start."""


@kernel
def symmetric_eigen(A, n, V):
    """Set the rows of V (n, n) to the eigenvectors of the symmetric matrix A (n, n), and the diagonal of A to their
    eigenvalues, in no order. Both are flat arrays, row by row. The upper triangle of A is read and lost."""
    largest = 0.0
    for i in range(n):
        largest = max(largest, abs(A[n * i + i]))
        for j in range(n):
            V[n * i + j] = 1.0 if i == j else 0.0
            largest = max(largest, abs(A[n * min(i, j) + max(i, j)]))
    for _ in range(SWEEPS):
        rotated = False
        for p in range(n - 1):
            for q in range(p + 1, n):
                if abs(A[n * p + q]) > NEGLIGIBLE * largest:
                    rotate(A, n, V, p, q)
                    rotated = True
        if not rotated:
            break


@kernel
def rotate(A, n, V, p, q):
    """Rotate the axes p < q of A and V so that A[p, q] is zero."""
    theta = 0.5 * (A[n * q + q] - A[n * p + p]) / A[n * p + q]
    t = 1.0 / (abs(theta) + math.sqrt(1.0 + theta * theta))
    if theta < 0.0:
        t = -t
    c = 1.0 / math.sqrt(1.0 + t * t)
    s = t * c
    A[n * p + p] -= t * A[n * p + q]
    A[n * q + q] += t * A[n * p + q]
    A[n * p + q] = 0.0
    for k in range(p):
        x, y = A[n * k + p], A[n * k + q]
        A[n * k + p] = c * x - s * y
        A[n * k + q] = s * x + c * y
    for k in range(p + 1, q):
        x, y = A[n * p + k], A[n * k + q]
        A[n * p + k] = c * x - s * y
        A[n * k + q] = s * x + c * y
    for k in range(q + 1, n):
        x, y = A[n * p + k], A[n * q + k]
        A[n * p + k] = c * x - s * y
        A[n * q + k] = s * x + c * y
    for k in range(n):
        x, y = V[n * p + k], V[n * q + k]
        V[n * p + k] = c * x - s * y
        V[n * q + k] = s * x + c * y
