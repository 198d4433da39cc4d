"""Names of symbols in machine code, apart from what needs NumPy or LLVM."""

LIBM = "uvms_mj_libm_"
"""The prefix of the symbols of functions in :mod:`.libm`."""
