"""Practicality: the paper's laws on a real vehicle, from ideal to real along each axis."""
