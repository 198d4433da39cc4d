r"""Linear algebra for small matrices in kernels: factors, substitutions and eigenvalues.

The matrices are the inertia M (N, N), N = 6 + n, of a vehicle with joints, the inertia of its tool, and the covariance
of a filter. They are at most 36 by 36, and symmetric positive definite where they are factored,

.. math::

    M = L L^\top, \quad L_{ij} = \frac{M_{ij} - \sum_{k<j} L_{ik} L_{jk}}{L_{jj}}

(Cholesky; Golub and Van Loan, "Matrix Computations", 2013, sec. 4.2). The array of L has the reciprocals 1 / L_ii on
its diagonal, because a division takes as long as many products. A matrix that is not positive definite gives NaN, which
ends the run at the next command.

Eigenvalues are found by cyclic Jacobi rotations (sec. 8.5). A rotation in the plane of two axes p < q makes the entry
a_pq zero. With :math:`\vartheta = (a_{qq} - a_{pp}) / (2 a_{pq})` its tangent is :math:`t = \pm 1 / (|\vartheta| +
\sqrt{1 + \vartheta^2})`, with the sign of :math:`\vartheta`. A sweep takes all pairs once. The other entries fall
quadratically: four or five sweeps are enough for matrices of 6 by 6.
"""

import math

import numpy as np

from .kernels import kernel


@kernel
def cholesky(M, L):
    """Set the lower triangle of L (N, N) to the factor of M (N, N), with the reciprocals of its diagonal. Only the
    lower triangle of M is read. L may be M."""
    for j in range(len(M)):
        x = M[j, j]
        for k in range(j):
            x -= L[j, k] * L[j, k]
        L[j, j] = 1.0 / math.sqrt(x) if x > 0.0 else math.nan
        for i in range(j + 1, len(M)):
            x = M[i, j]
            for k in range(j):
                x -= L[i, k] * L[j, k]
            L[i, j] = x * L[j, j]


@kernel
def forward(L, B):
    """B, (N,) or (N, columns), becomes L^-1 B, for L of :func:`cholesky`."""
    for i in range(len(L)):
        for k in range(i):
            B[i] -= L[i, k] * B[k]
        B[i] *= L[i, i]


@kernel
def backward(L, B):
    """B, (N,) or (N, columns), becomes L^-T B, for L of :func:`cholesky`."""
    for i in range(len(L) - 1, -1, -1):
        for k in range(i + 1, len(L)):
            B[i] -= L[k, i] * B[k]
        B[i] *= L[i, i]


@kernel
def inverse(L, A):
    """Set A (N, N) to (L L^T)^-1 = L^-T L^-1, for L of :func:`cholesky`; A is exactly symmetric."""
    for i in range(len(L)):  # L^-1
        for j in range(i):
            x = 0.0
            for k in range(j, i):
                x -= L[i, k] * A[k, j]
            A[i, j] = x * L[i, i]
        A[i, i] = L[i, i]
    for i in range(len(L)):  # an entry needs those below and at its right, which are still of L^-1
        for j in range(i + 1):
            x = 0.0
            for k in range(i, len(L)):
                x += A[k, i] * A[k, j]
            A[i, j], A[j, i] = x, x


SWEEPS = 20
"""Most sweeps; ten are enough for matrices up to 36 by 36."""
NEGLIGIBLE = 1e-15
"""An entry off the diagonal is negligible below this share of the largest one on it, at the start."""


@kernel
def symmetric_eigen(A, V):
    """Set the rows of V (n, n) to the eigenvectors of the symmetric matrix A (n, n), and the diagonal of A to their
    eigenvalues, in no order. The upper triangle of A is read and lost."""
    n, largest = len(A), 0.0
    for i in range(n):
        for j in range(i, n):
            largest = max(largest, abs(A[i, j]))
    V[:] = np.eye(n)
    for _ in range(SWEEPS):
        rotated = False
        for p in range(n - 1):
            for q in range(p + 1, n):
                if abs(A[p, q]) > NEGLIGIBLE * largest:
                    rotate(A, V, p, q)
                    rotated = True
        if not rotated:
            break


@kernel
def rotate(A, V, p, q):
    """Rotate the axes p < q of A and V so that A[p, q] is zero."""
    theta = 0.5 * (A[q, q] - A[p, p]) / A[p, q]
    t = math.copysign(1.0, theta) / (abs(theta) + math.sqrt(1.0 + theta * theta))
    c = 1.0 / math.sqrt(1.0 + t * t)
    s = t * c
    A[p, p] -= t * A[p, q]
    A[q, q] += t * A[p, q]
    A[p, q] = 0.0
    for k in range(p):
        A[k, p], A[k, q] = c * A[k, p] - s * A[k, q], s * A[k, p] + c * A[k, q]
    for k in range(p + 1, q):
        A[p, k], A[k, q] = c * A[p, k] - s * A[k, q], s * A[p, k] + c * A[k, q]
    for k in range(q + 1, len(A)):
        A[p, k], A[q, k] = c * A[p, k] - s * A[q, k], s * A[p, k] + c * A[q, k]
    for k in range(len(A)):
        V[p, k], V[q, k] = c * V[p, k] - s * V[q, k], s * V[p, k] + c * V[q, k]


@kernel
def solved(A, b):
    """The solution x (n,) of A x = b, by Gaussian elimination with the largest pivots; NaN or infinite for a singular
    A (n, n). And the smallest pivot over the largest one."""
    n, U, x, least, most = len(b), A.copy(), b.copy(), math.inf, 0.0
    for k in range(n):
        pivot = k
        for i in range(k + 1, n):
            if abs(U[i, k]) > abs(U[pivot, k]):
                pivot = i
        if pivot != k:
            for j in range(k, n):
                U[k, j], U[pivot, j] = U[pivot, j], U[k, j]
            x[k], x[pivot] = x[pivot], x[k]
        for i in range(k + 1, n):
            scale = U[i, k] / U[k, k]
            for j in range(k + 1, n):
                U[i, j] -= scale * U[k, j]
            x[i] -= scale * x[k]
        least, most = min(least, abs(U[k, k])), max(most, abs(U[k, k]))
    for r in range(n):
        i = n - 1 - r
        for j in range(i + 1, n):
            x[i] -= U[i, j] * x[j]
        x[i] /= U[i, i]
    return x, least / most
