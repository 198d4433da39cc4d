"""The draws that laws are judged on: known ones for development, or blind ones, from a secret or a seed that is given
after the laws are fixed."""

import hashlib
import hmac
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ...errors import InputError, shortened
from ...files import is_file

DEVELOPMENT = "development"
LEAST_BYTES = 16
"""Least size of a secret: 128 bits can't be guessed."""
MOST_DIGITS = 100
"""Most digits of the number of draws."""


@dataclass(frozen=True)
class Draws:
    """Where the draws are from.

    Attributes:
        kind: "development", "seed" or "secret".
        key: the bytes that decide all draws.
        seed_given: of the kind "seed", the number.
    """

    kind: str = DEVELOPMENT
    key: bytes = DEVELOPMENT.encode()
    seed_given: int | None = None

    @classmethod
    def parsed(cls, text: str) -> "Draws":
        """Read ``development``, ``seed:NUMBER`` or ``secret:FILE``. Raises InputError for anything else, and for a file
        of less than :data:`LEAST_BYTES` bytes."""
        kind, colon, value = text.partition(":")
        if text == DEVELOPMENT:
            return cls()
        if kind == "seed" and value.isascii() and value.isdigit():
            if len(value) > MOST_DIGITS:
                raise InputError(f"draws: the seed has {len(value)} digits; it may have {MOST_DIGITS}")
            return cls("seed", f"seed {int(value)}".encode(), int(value))
        if kind == "secret" and value:
            if not is_file(value):
                raise InputError(
                    f"draws: {value}: no such file; a secret is a file of {LEAST_BYTES} random bytes or more"
                )
            key = Path(value).read_bytes()
            if len(key) < LEAST_BYTES:
                raise InputError(f"draws: {value} has {len(key)} bytes; a secret has at least {LEAST_BYTES}")
            return cls("secret", key)
        wanted = f"{DEVELOPMENT}, seed:NUMBER or secret:FILE"
        raise InputError(
            f"draws: {shortened(text)} is not known; give {wanted}" + ("" if colon or text else ", not an empty text")
        )

    @property
    def blind(self) -> bool:
        """Whether the draws are not the known ones of the development."""
        return self.kind != DEVELOPMENT

    def seed(self, task: str, level: int) -> int:
        """design.seed of a level of a task, below 2^48. It tells nothing of the key, nor of other seeds."""
        digest = hmac.digest(self.key, f"Contact-10 2 {task} {level}".encode(), "sha256")
        return int.from_bytes(digest[:6])

    def named(self) -> dict[str, Any]:
        """The draws in a result: their kind, and the seed, or of a secret the digest, which can be published before."""
        if self.kind == "secret":
            return {"kind": self.kind, "digest": hashlib.sha256(self.key).hexdigest()}
        return {"kind": self.kind} | ({} if self.seed_given is None else {"seed": self.seed_given})


KNOWN = Draws()
"""The known draws, for development."""
