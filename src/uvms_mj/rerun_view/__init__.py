"""Runs in the Rerun viewer: the only code that knows Rerun. Everything listens on this machine alone."""

from .viewer import LiveView, save, serve, show

__all__ = ["LiveView", "save", "serve", "show"]
