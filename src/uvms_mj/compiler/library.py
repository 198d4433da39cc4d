"""Functions written in the language itself. They are plain Python, too, and are compiled where a user's function calls
NumPy's function of the same meaning."""

import math

import numpy as np


def remainder(a, b):
    """``a % b`` of floats: with the sign of b."""
    rest = math.fmod(a, b)
    if b == 0.0:
        return rest
    if rest != 0.0:
        if (b < 0.0) != (rest < 0.0):
            rest += b
        return rest
    return math.copysign(0.0, b)


def floor_divide(a, b):
    """``a // b`` of floats."""
    if b == 0.0:
        return a / b
    rest = math.fmod(a, b)
    quotient = (a - rest) / b
    if rest != 0.0 and (b < 0.0) != (rest < 0.0):
        quotient -= 1.0
    if quotient == 0.0:
        return math.copysign(0.0, a / b)
    below = np.floor(quotient)
    return below + 1.0 if quotient - below > 0.5 else below


def factored(A, order):
    """The factors L and U of a matrix in one, with rows exchanged as ``order`` says (0, 1, ... before); and whether the
    number of exchanges is odd, as -1.0 or 1.0. A singular matrix has a zero on the diagonal."""
    n = len(order)
    U = A + 0.0
    parity = 1.0
    for k in range(n):
        best = k
        for i in range(k + 1, n):
            if abs(U[i, k]) > abs(U[best, k]):
                best = i
        if best != k:
            for j in range(n):
                U[k, j], U[best, j] = U[best, j], U[k, j]
            order[k], order[best] = order[best], order[k]
            parity = -parity
        if U[k, k] != 0.0:
            for i in range(k + 1, n):
                U[i, k] /= U[k, k]
                for j in range(k + 1, n):
                    U[i, j] -= U[i, k] * U[k, j]
    return U, parity


def solve(A, b):
    """The solution x of A x = b, for one right side (n,)."""
    return solve_all(A, b.reshape(len(b), 1))[:, 0]


def solve_all(A, B):
    """The solution X of A X = B, for several right sides (n, m)."""
    n = len(A)
    order = np.arange(n)
    U, _ = factored(A, order)
    for i in range(n):
        if U[i, i] == 0.0:
            raise np.linalg.LinAlgError("Singular matrix")
    X = np.zeros(B.shape)
    for c in range(B.shape[1]):
        for i in range(n):
            x = B[order[i], c] + 0.0
            for j in range(i):
                x -= U[i, j] * X[j, c]
            X[i, c] = x
        for k in range(n):
            i = n - 1 - k
            for j in range(i + 1, n):
                X[i, c] -= U[i, j] * X[j, c]
            X[i, c] /= U[i, i]
    return X


def inv(A):
    """The inverse of a matrix."""
    return solve_all(A, np.eye(len(A)))


def det(A):
    """The determinant of a matrix."""
    U, product = factored(A, np.arange(len(A)))
    for i in range(len(A)):
        product *= U[i, i]
    return product


def cholesky(A):
    """The lower triangular L with A = L L'. Only the lower triangle of A is read."""
    n = len(A)
    L = np.zeros((n, n))
    for j in range(n):
        square = A[j, j] + 0.0
        for k in range(j):
            square -= L[j, k] * L[j, k]
        if not square > 0.0:
            raise np.linalg.LinAlgError("Matrix is not positive definite")
        L[j, j] = math.sqrt(square)
        for i in range(j + 1, n):
            x = A[i, j] + 0.0
            for k in range(j):
                x -= L[i, k] * L[j, k]
            L[i, j] = x / L[j, j]
    return L


def cross(a, b):
    """The cross product of two vectors (3,)."""
    return np.array([a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]])


def interp(x, xp, fp):
    """Linear interpolation in a table; the first or the last value beyond it."""
    n = len(xp)
    if x != x:
        return x
    if x <= xp[0]:
        return fp[0] + 0.0
    if x >= xp[n - 1]:
        return fp[n - 1] + 0.0
    low, high = 0, n - 1
    while high - low > 1:
        middle = (low + high) // 2
        if x >= xp[middle]:
            low = middle
        else:
            high = middle
    return (fp[low + 1] - fp[low]) / (xp[low + 1] - xp[low]) * (x - xp[low]) + fp[low]


def solve_either(A, b):
    """The solution of A x = b, for one right side or several."""
    return solve(A, b) if b.ndim == 1 else solve_all(A, b)


REPLACED = {np.linalg.solve: solve_either, np.linalg.inv: inv, np.linalg.det: det, np.linalg.cholesky: cholesky}
"""NumPy's functions of which machine code has other digits, each with the function that it has in place of it."""


def sort(a):
    """The numbers of a vector in ascending order, NaN at the end."""
    s = a.copy()
    for i in range(1, len(s)):
        value = s[i]
        j = i
        while j > 0 and (value < s[j - 1] or (s[j - 1] != s[j - 1] and value == value)):
            s[j] = s[j - 1]
            j -= 1
        s[j] = value
    return s


def argsort(a):
    """The indices of a vector's numbers in ascending order; equal numbers keep theirs."""
    order = np.arange(len(a))
    for i in range(1, len(a)):
        j = i
        while j > 0 and (a[i] < a[order[j - 1]] or (a[order[j - 1]] != a[order[j - 1]] and a[i] == a[i])):
            order[j] = order[j - 1]
            j -= 1
        order[j] = i
    return order


def argsort_distinct(a):
    """As :func:`argsort`; NumPy's order of equal numbers is not known."""
    order = argsort(a)
    for i in range(1, len(a)):
        if not a[order[i - 1]] < a[order[i]]:
            raise ValueError("equal numbers have no order")
    return order


def sorted_stable(a):
    """As :func:`sort`; Python's own order of NaN is not known."""
    for value in a:
        if value != value:
            raise ValueError("NaN has no order")
    return sort(a)


def sorted_back(a):
    """In descending order; equal numbers keep their order."""
    s = sorted_stable(-a)
    return -s


def place(a, value, right):
    """Where a number belongs in a vector of ascending numbers, by bisection; ``right``: behind equal ones."""
    low, high = 0, len(a)
    while low < high:
        middle = (low + high) // 2
        known = a[middle]
        before = known < value or (value != value and known == known)
        if right and not before:
            before = not (value < known or (known != known and value == value))
        if before:
            low = middle + 1
        else:
            high = middle
    return low


def place_in_bins(a, value, behind):
    """As :func:`place`. Raises unless the numbers of the vector ascend."""
    for i in range(1, len(a)):
        if not a[i - 1] <= a[i]:
            raise ValueError("the bins must ascend")
    return place(a, value, behind)
