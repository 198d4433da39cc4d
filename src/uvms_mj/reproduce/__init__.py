"""Experiments of others, repeated: the paper, the practicality of its law, measurements in a pool."""
