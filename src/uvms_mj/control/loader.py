"""Names of laws that other modules still import from here."""

from ..stages.base import is_shipped as has_built_in_law
from . import BUILT_IN

__all__ = ["BUILT_IN", "has_built_in_law"]
