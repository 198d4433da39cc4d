"""Machine code for MuJoCo's callback. Only this package uses pointers, symbols and the registry; it calls the pure
functions of the modules above it."""
