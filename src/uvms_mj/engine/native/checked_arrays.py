"""NumPy's checks that numba omits: the shape of an output argument, and an index of ``array.flat``."""

from typing import Any

from numba import types
from numba.core import cgutils
from numba.np import npyimpl


def same_shapes(kernel: Any) -> Any:
    """Wrap numba's loop over the elements of an array operation with NumPy's check of the output's shape, as in
    ``a += b`` and ``np.add(a, b, out)``."""

    def checked(context, builder, signature, arguments, ufunc, kernel_class):
        outputs = [
            (arg, kind)
            for arg, kind in zip(arguments[ufunc.nin :], signature.args[ufunc.nin :], strict=False)
            if isinstance(kind, types.ArrayCompatible)
        ]
        inputs = list(zip(arguments, signature.args, strict=False))[: ufunc.nin]
        for output, kind in outputs:
            shape = npyimpl._prepare_argument(context, builder, output, kind).shape
            for argument, input_kind in (*inputs, *outputs):
                given = getattr(npyimpl._prepare_argument(context, builder, argument, input_kind), "shape", ())
                _refuse_unless_broadcast(context, builder, given, shape)
        return kernel(context, builder, signature, arguments, ufunc, kernel_class)

    return checked


def _refuse_unless_broadcast(context: Any, builder: Any, given: Any, shape: Any) -> None:
    one = context.get_constant(types.intp, 1)
    wrong = cgutils.false_bit
    if len(given) > len(shape):
        wrong = cgutils.true_bit
    for n, wanted in zip(reversed(given), reversed(shape), strict=False):
        fits = builder.or_(builder.icmp_signed("==", n, one), builder.icmp_signed("==", n, wanted))
        wrong = builder.or_(wrong, builder.not_(fits))
    with cgutils.if_unlikely(builder, wrong):
        message = "operands could not be broadcast to the shape of the output"
        context.call_conv.return_user_exc(builder, ValueError, (message,))


def within_bounds(make: Any) -> Any:
    """Wrap numba's maker of the class behind ``array.flat`` with a check of the index. As in NumPy, a negative index
    counts from the end."""

    def checked_class(kind):
        plain: Any = make(kind)

        def index_of(context, builder, array, index):
            size = array.nitems
            index = context.cast(builder, index, types.intp, types.intp) if index.type == size.type else index
            index = builder.sext(index, size.type) if index.type.width < size.type.width else index
            negative = builder.icmp_signed("<", index, index.type(0))
            index = builder.select(negative, builder.add(index, size), index)
            cgutils.do_boundscheck(context, builder, index, size)
            return index

        class Checked(plain):
            def getitem(self, context, builder, kind, array, index):
                return super().getitem(context, builder, kind, array, index_of(context, builder, array, index))

            def setitem(self, context, builder, kind, array, index, value):
                super().setitem(context, builder, kind, array, index_of(context, builder, array, index), value)

        return Checked

    return checked_class
