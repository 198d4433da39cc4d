"""Functions written in the language itself. They are plain Python, too, and are compiled where a user's function calls
NumPy's function of the same meaning."""

import math

import numpy as np


def raises():
    """Whether NumPy's error is raised here: known when compiling. A kernel of the package does not raise; where a
    matrix is singular, or not positive definite, its result is NaN."""
    return True


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


def jacobi_rotation(a, b, c):
    """Cosine and sine of the rotation that makes the matrix [a, c; c, b] diagonal, with c not 0."""
    z = (b - a) / (2.0 * c)
    t = math.copysign(1.0, z) / (abs(z) + math.sqrt(1.0 + z * z))
    cosine = 1.0 / math.sqrt(1.0 + t * t)
    return cosine, cosine * t


def turn(A, i, j, cosine, sine):
    """Rotate the columns i and j of A into each other."""
    for k in range(A.shape[0]):
        x, y = A[k, i], A[k, j]
        A[k, i] = cosine * x - sine * y
        A[k, j] = sine * x + cosine * y


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
    X = np.zeros(B.shape)
    for i in range(n):
        if U[i, i] == 0.0:
            if raises():
                raise np.linalg.LinAlgError("Singular matrix")
            X[:] = np.nan
            return X
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
            if raises():
                raise np.linalg.LinAlgError("Matrix is not positive definite")
            L[:] = np.nan
            return L
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


def interp(x, xp, fp, left, right):
    """Linear interpolation in a table at each number of a vector, as NumPy searches: each search begins where the one
    before has ended, which matters where the table is in no order."""
    n = len(xp)
    found = np.zeros(len(x))
    j = 0
    for i in range(len(x)):
        j = interval(x[i], xp, n, j)
        if x[i] != x[i]:
            found[i] = x[i]
        elif j == -1:
            found[i] = left
        elif j == n:
            found[i] = right
        elif j == n - 1 or xp[j] == x[i]:
            found[i] = fp[j]
        else:
            slope = (fp[j + 1] - fp[j]) / (xp[j + 1] - xp[j])
            found[i] = slope * (x[i] - xp[j]) + fp[j]
            if found[i] != found[i]:
                found[i] = slope * (x[i] - xp[j + 1]) + fp[j + 1]
                if found[i] != found[i] and fp[j] == fp[j + 1]:
                    found[i] = fp[j]
    return found


def interval(key, xp, n, guess):
    """The index of the interval of a table with a number; -1 before the first one, n behind the last one."""
    if key > xp[n - 1]:
        return n
    if key < xp[0]:
        return -1
    if n <= 4:
        i = 1
        while i < n and key >= xp[i]:
            i += 1
        return i - 1
    low, high = 0, n
    guess = max(min(guess, n - 3), 1)
    if key < xp[guess]:
        if key >= xp[guess - 1]:
            return guess - 1
        high = guess - 1
        if guess > 8 and key >= xp[guess - 8]:
            low = guess - 8
    else:
        if key < xp[guess + 1]:
            return guess
        if key < xp[guess + 2]:
            return guess + 1
        low = guess + 2
        if guess < n - 8 - 1 and key < xp[guess + 8]:
            high = guess + 8
    while low < high:
        middle = low + (high - low) // 2
        if key >= xp[middle]:
            low = middle + 1
        else:
            high = middle
    return low - 1


def heaviside(x, at_zero):
    """0 below zero, 1 above."""
    if x != x:
        return x
    if x == 0.0:
        return at_zero
    return 0.0 if x < 0.0 else 1.0


def logaddexp(x, y):
    """log(exp(x) + exp(y))."""
    if x == y:
        return x + 0.693147180559945309417232121458176568
    off = x - y
    if off > 0.0:
        return x + math.log1p(math.exp(-off))
    if off <= 0.0:
        return y + math.log1p(math.exp(off))
    return off


def isclose(a, b, relative, absolute):
    """As ``math.isclose``."""
    if a == b:
        return True
    off = abs(b - a)
    if abs(a) == math.inf or abs(b) == math.inf:
        return False
    return off <= abs(relative * b) or off <= abs(relative * a) or off <= absolute


def modf(x):
    """The parts of a number behind the point and before it."""
    before = np.trunc(x)
    behind = x - before if before - before == 0.0 or x != x else 0.0
    return np.copysign(behind, x), before


def gcd(a, b):
    """The greatest common divisor."""
    a, b = abs(a), abs(b)
    while b != 0:
        a, b = b, a % b
    return a


def sinc(x):
    """sin(pi x) / (pi x)."""
    angle = math.pi * x
    some = np.where(angle != 0.0, angle, 2.220446049250313e-16)
    return np.sin(some) / some


def gradient(f, h):
    """Central differences of a vector, one-sided at its ends."""
    n = len(f)
    found = np.zeros(n)
    for i in range(1, n - 1):
        found[i] = (f[i + 1] - f[i - 1]) / (2.0 * h)
    found[0] = (f[1] - f[0]) / h
    found[n - 1] = (f[n - 1] - f[n - 2]) / h
    return found


def convolve_full(a, v):
    """All sums of products of a convolution."""
    found = np.zeros(len(a) + len(v) - 1)
    for i in range(len(a)):
        for j in range(len(v)):
            found[i + j] += a[i] * v[j]
    return found


def part_of_convolution(n, m, mode):
    """The first number and the size of the part of a whole convolution that a mode takes."""
    most, least = max(n, m), min(n, m)
    return {"full": (0, n + m - 1), "same": ((least - 1) // 2, most), "valid": (least - 1, most - least + 1)}[mode]


def convolve(a, v, mode="full"):
    """As NumPy's."""
    a, v = np.asarray(a, float), np.asarray(v, float)
    first, size = part_of_convolution(len(a), len(v), mode)
    return convolve_full(a, v)[first : first + size]


def unwrap(p):
    """Angles without jumps of more than pi [rad]."""
    found = p.copy()
    total = 0.0
    for i in range(1, len(p)):
        off = p[i] - p[i - 1]
        wrapped = remainder(off + math.pi, 2.0 * math.pi) - math.pi
        if wrapped == -math.pi and off > 0.0:
            wrapped = math.pi
        step = 0.0 if abs(off) < math.pi else wrapped - off
        total = total + step if i > 1 else step
        found[i] = p[i] + total
    return found


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


def slogdet(A):
    """The sign of a determinant and the logarithm of its size."""
    U, sign = factored(A, np.arange(len(A)))
    total = 0.0
    for i in range(len(A)):
        sign *= np.sign(U[i, i])
        total += np.log(abs(U[i, i]))
    if total != total:
        raise np.linalg.LinAlgError("the matrix has NaN")
    return sign, total


def orthogonal_columns(A):
    """A matrix B = A V with orthogonal columns, and the orthogonal V, by rotations of two columns at a time (Hestenes):
    the columns' lengths are the singular values of A."""
    m, n = A.shape
    B = A + 0.0
    V = np.eye(n)
    for _ in range(60):
        rotations = 0
        for i in range(n - 1):
            for j in range(i + 1, n):
                a, b, c = 0.0, 0.0, 0.0
                for k in range(m):
                    a += B[k, i] * B[k, i]
                    b += B[k, j] * B[k, j]
                    c += B[k, i] * B[k, j]
                if not abs(c) <= 1e-16 * math.sqrt(a) * math.sqrt(b):
                    rotations += 1
                    cosine, sine = jacobi_rotation(a, b, c)
                    turn(B, i, j, cosine, sine)
                    turn(V, i, j, cosine, sine)
        if rotations == 0:
            break
    return B, V


def lengths(B):
    """Of the columns of a matrix."""
    m, n = B.shape
    found = np.zeros(n)
    for j in range(n):
        total = 0.0
        for k in range(m):
            total += B[k, j] * B[k, j]
        found[j] = math.sqrt(total)
    return found


def demand_rank(s, cutoff):
    """Raises where it depends on rounding whether a singular value counts; so, too, with NaN."""
    noise = 1e-13 * s.max()
    for each in s:
        if not (each > cutoff + noise or each + noise < cutoff or (each == 0.0 and noise == 0.0)):
            raise np.linalg.LinAlgError("the rank depends on rounding")
    return noise


def singular_values(A):
    """The singular values of a matrix in descending order."""
    if A.shape[0] >= A.shape[1]:
        B, _ = orthogonal_columns(A)
    else:
        B, _ = orthogonal_columns(A.T)
    if not np.all(np.isfinite(B)):
        raise np.linalg.LinAlgError("SVD did not converge")
    return -sort(-lengths(B))


def condition(A):
    """The ratio of the greatest and the least singular value. Raises where that depends on rounding."""
    s = singular_values(A)
    least = s[len(s) - 1]
    if not least > 1e-12 * s[0]:
        raise np.linalg.LinAlgError("the matrix is nearly singular")
    return s[0] / least


def tall_inverse(A, rcond):
    """The pseudoinverse of a matrix with at least as many rows as columns."""
    m, n = A.shape
    B, V = orthogonal_columns(A)
    s = lengths(B)
    cutoff = rcond * s.max()
    demand_rank(s, cutoff)
    X = np.zeros((n, m))
    for k in range(n):
        if s[k] > cutoff:
            for i in range(n):
                for j in range(m):
                    X[i, j] += V[i, k] / s[k] * (B[j, k] / s[k])
    return X


def pseudo_inverse(A, rcond):
    """The pseudoinverse of a matrix, without singular values of at most ``rcond`` times the greatest one."""
    if A.shape[0] >= A.shape[1]:
        return tall_inverse(A, rcond)
    X = tall_inverse(A.T, rcond)
    return X.T.copy()


def least_squares(A, B, rcond):
    """The least X of all with the least |A X - B|, column by column; the squares of the rest, and the singular
    values. Raises where A has not its full rank."""
    s = singular_values(A)
    demand_rank(s, rcond * s[0])
    if not s[len(s) - 1] > rcond * s[0]:
        raise np.linalg.LinAlgError("the matrix has not its full rank")
    P = pseudo_inverse(A, rcond)
    X = P @ B
    X += P @ (B - A @ X)
    rest = np.zeros(B.shape[1])
    for c in range(B.shape[1]):
        off = A @ X[:, c] - B[:, c]
        rest[c] = off @ off
    return X, rest, s


def eigenvalues(A):
    """The eigenvalues of a symmetric matrix, of which the lower triangle is read, in ascending order (Jacobi)."""
    n = len(A)
    S = np.zeros((n, n))
    for i in range(n):
        for j in range(i + 1):
            S[i, j] = A[i, j]
            S[j, i] = A[i, j]
    if not np.all(np.isfinite(S)):
        raise np.linalg.LinAlgError("Eigenvalues did not converge")
    for _ in range(60):
        rotations = 0
        for i in range(n - 1):
            for j in range(i + 1, n):
                if not abs(S[i, j]) <= 1e-17 * (abs(S[i, i]) + abs(S[j, j])):
                    rotations += 1
                    cosine, sine = jacobi_rotation(S[i, i], S[j, j], S[i, j])
                    turn(S, i, j, cosine, sine)
                    turn(S.T, i, j, cosine, sine)
        if rotations == 0:
            break
    values = np.zeros(n)
    for i in range(n):
        values[i] = S[i, i]
    return sort(values)


# as NumPy's functions are called; these are not compiled themselves


def power_of_matrix(a, n, product, copied):
    """The power of a matrix, n > 0, with products in NumPy's order."""
    if n <= 3:
        return [copied, lambda a: product(a, a), lambda a: product(product(a, a), a)][n - 1](a)
    square, result = None, None
    while n > 0:
        square = a if square is None else product(square, square)
        n, bit = divmod(n, 2)
        if bit:
            result = square if result is None else product(result, square)
    return result


def read_subscripts(subscripts, shapes):
    """The letters of each operand of ``np.einsum`` and of its result, and the size of each. Raises ValueError."""
    if not isinstance(subscripts, str) or "." in subscripts:
        raise ValueError("the subscripts are a text of letters here")
    given, arrow, out = subscripts.replace(" ", "").partition("->")
    letters = given.split(",")
    if [len(of) for of in letters] != [len(shape) for shape in shapes]:
        raise ValueError(f"the subscripts {subscripts!r} do not fit the shapes {shapes}")
    together = "".join(letters)
    if not arrow:
        out = "".join(sorted(each for each in set(together) if together.count(each) == 1))
    sizes = {}
    for of, shape in zip(letters, shapes, strict=True):
        for letter, size in zip(of, shape, strict=True):
            if sizes.setdefault(letter, size) != size:
                raise ValueError(f"the subscript {letter} has several sizes")
    if len(set(out)) != len(out) or not set(out) <= set(sizes) or not together.isalpha():
        raise ValueError(f"the subscripts {subscripts!r} do not fit")
    return letters, out, sizes


def _einsum(subscripts, *operands):
    operands = [np.asarray(each) for each in operands]
    letters, out, sizes = read_subscripts(subscripts, [each.shape for each in operands])
    summed = [each for each in sizes if each not in out]
    result = np.zeros([sizes[each] for each in out], np.result_type(*operands))
    for index in np.ndindex(*result.shape):
        total = None
        for k in np.ndindex(*(sizes[each] for each in summed)):
            places = dict(zip((*out, *summed), (*index, *k), strict=True))
            term = None
            for x, of in zip(operands, letters, strict=True):
                entry = x[tuple(places[letter] for letter in of)]
                term = entry if term is None else term * entry
            total = term if total is None else total + term
        result[index] = total
    return result[()]


def _solve(a, b):
    a, b = np.asarray(a, float), np.asarray(b, float)
    return solve(a, b) if b.ndim == 1 else solve_all(a, b)


def _of_matrix(function):
    def of(a):
        return function(np.asarray(a, float))

    return of


def _matrix_power(a, n):
    a = np.asarray(a)
    if n == 0:
        return np.eye(len(a), dtype=a.dtype)
    return power_of_matrix(inv(np.asarray(a, float)) if n < 0 else a, abs(n), lambda a, b: a @ b, np.copy)


def _inner(a, b):
    return a @ np.transpose(b) if np.ndim(a) and np.ndim(b) else a * np.asarray(b)


def _vdot(a, b):
    return np.ravel(a) @ np.ravel(b)


def _multi_dot(arrays):
    result = arrays[0]
    for each in arrays[1:]:
        result = result @ each
    return result


def _tensordot(a, b, axes=2):
    return np.asarray(a) @ np.asarray(b)


def _pinv(a, rcond=None, hermitian=False, *, rtol=None):
    given = rcond if rtol is None else rtol
    return pseudo_inverse(np.asarray(a, float), 1e-15 if given is None else float(given))


def _lstsq(a, b, rcond=None):
    a, b = np.asarray(a, float), np.asarray(b, float)
    usual = float(np.finfo(float).eps * max(a.shape))
    x, rest, s = least_squares(a, b.reshape(len(b), -1), usual if rcond is None else float(rcond))
    few = a.shape[0] <= a.shape[1]
    return x if b.ndim == 2 else x[:, 0], np.zeros(0) if few else rest, min(a.shape), s


def _svd(a, full_matrices=True, compute_uv=True):
    return singular_values(np.asarray(a, float))


def _cond(x, p=None):
    return condition(np.asarray(x, float))


def _eigvalsh(a, UPLO="L"):
    return eigenvalues(np.asarray(a, float))


REPLACED = {
    np.linalg.solve: _solve,
    np.linalg.inv: _of_matrix(inv),
    np.linalg.det: _of_matrix(det),
    np.linalg.cholesky: _of_matrix(cholesky),
    np.linalg.slogdet: _of_matrix(slogdet),
    np.linalg.matrix_power: _matrix_power,
    np.linalg.multi_dot: _multi_dot,
    np.linalg.pinv: _pinv,
    np.linalg.lstsq: _lstsq,
    np.linalg.svd: _svd,
    np.linalg.cond: _cond,
    np.linalg.eigvalsh: _eigvalsh,
    np.inner: _inner,
    np.vdot: _vdot,
    np.tensordot: _tensordot,
    np.einsum: _einsum,
    np.convolve: convolve,
    np.sinc: sinc,
}
"""NumPy's functions of which machine code has other digits, each with the function that it has in place of it."""
