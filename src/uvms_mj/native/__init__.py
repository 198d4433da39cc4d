"""The machine-code side: the only code that knows pointers, symbols and the registry. It calls the pure functions
above it."""

from .attachment import Attachment, attach

__all__ = ["Attachment", "attach"]
