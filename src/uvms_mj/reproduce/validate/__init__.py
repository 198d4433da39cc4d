"""Runs that are compared with measurements in a pool."""
