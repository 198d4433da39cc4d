r"""Linear algebra for small matrices in kernels: factors, substitutions, products and eigenvalues.

Linear algebra for matrices whose size is known at run time only: factors, substitutions and products.

A matrix (rows, columns) is a flat array, row by row. The matrices are those of a vehicle with joints: the inertia M (N,
N) with N = 6 + n, the Jacobian of a tool, and the inertia that the tool has. They are small, at most 36 by 36, and
symmetric positive definite where they are factored,

.. math::

    M = L L^\top, \quad L_{ij} = \frac{M_{ij} - \sum_{k<j} L_{ik} L_{jk}}{L_{jj}}

(Cholesky; Golub and Van Loan, "Matrix Computations", 2013, sec. 4.2). The array of L has the reciprocals 1 / L_ii on
its diagonal, because a division takes as long as many products. A matrix that is not positive definite gives NaN, which
ends the run at the next command.

Eigenvalues of small symmetric matrices, by cyclic Jacobi rotations (Golub and Van Loan, "Matrix Computations",
2013, sec. 8.5).

A rotation in the plane of two axes p < q makes the entry a_pq zero. With :math:`\vartheta = (a_{qq} - a_{pp}) / (2
a_{pq})` its tangent is :math:`t = \pm 1 / (|\vartheta| + \sqrt{1 + \vartheta^2})`, with the sign of
:math:`\vartheta`. A sweep takes all pairs once. The other entries fall quadratically: four or five sweeps are enough
for matrices of 6 by 6.
"""

import math

from .kernels import kernel


@kernel
def cholesky(M, N, L):
    """Set the lower triangle of L (N, N) to the factor of M (N, N), with the reciprocals of its diagonal. Only the
    lower triangle of M is read. L may be M."""
    for j in range(N):
        x = M[N * j + j]
        for k in range(j):
            x -= L[N * j + k] * L[N * j + k]
        L[N * j + j] = 1.0 / math.sqrt(x) if x > 0.0 else math.nan
        for i in range(j + 1, N):
            x = M[N * i + j]
            for k in range(j):
                x -= L[N * i + k] * L[N * j + k]
            L[N * i + j] = x * L[N * j + j]


@kernel
def forward(L, N, B, columns):
    """B (N, columns) becomes L^-1 B, for L of :func:`cholesky`."""
    for i in range(N):
        for k in range(i):
            scale = L[N * i + k]
            for c in range(columns):
                B[columns * i + c] -= scale * B[columns * k + c]
        scale = L[N * i + i]
        for c in range(columns):
            B[columns * i + c] *= scale


@kernel
def backward(L, N, B, columns):
    """B (N, columns) becomes L^-T B, for L of :func:`cholesky`."""
    for i in range(N - 1, -1, -1):
        for k in range(i + 1, N):
            scale = L[N * k + i]
            for c in range(columns):
                B[columns * i + c] -= scale * B[columns * k + c]
        scale = L[N * i + i]
        for c in range(columns):
            B[columns * i + c] *= scale


@kernel
def gram(Y, rows, columns, A):
    """Set A (columns, columns) to Y^T Y, for Y (rows, columns)."""
    for i in range(columns):
        for j in range(i + 1):
            x = 0.0
            for k in range(rows):
                x += Y[columns * k + i] * Y[columns * k + j]
            A[columns * i + j] = x
            A[columns * j + i] = x


@kernel
def inverse(L, N, A):
    """Set A (N, N) to (L L^T)^-1 = L^-T L^-1, for L of :func:`cholesky`; A is exactly symmetric."""
    for i in range(N):  # L^-1
        for j in range(i):
            x = 0.0
            for k in range(j, i):
                x -= L[N * i + k] * A[N * k + j]
            A[N * i + j] = x * L[N * i + i]
        A[N * i + i] = L[N * i + i]
    for i in range(N):  # an entry needs those below and at its right, which are still of L^-1
        for j in range(i + 1):
            x = 0.0
            for k in range(i, N):
                x += A[N * k + i] * A[N * k + j]
            A[N * i + j] = x
            A[N * j + i] = x


@kernel
def product(A, rows, inner, B, columns, out):
    """Set out (rows, columns) to A B, for A (rows, inner) and B (inner, columns); out is neither of them."""
    for i in range(rows):
        for c in range(columns):
            x = 0.0
            for k in range(inner):
                x += A[inner * i + k] * B[columns * k + c]
            out[columns * i + c] = x


@kernel
def transposed_product(A, rows, inner, x, out):
    """Set out (inner,) to A^T x, for A (rows, inner) and x (rows,); out is not x."""
    for i in range(inner):
        y = 0.0
        for k in range(rows):
            y += A[inner * k + i] * x[k]
        out[i] = y


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
