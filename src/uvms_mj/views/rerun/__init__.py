"""Runs in the Rerun viewer. Only this package uses Rerun. All of its servers listen on this machine only."""

from .viewer import LiveView, save, serve, show

__all__ = ["LiveView", "save", "serve", "show"]
