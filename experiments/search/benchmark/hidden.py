"""Hidden seeds: a file that a maintainer keeps, whose digest is in the repository, until a release reveals it."""

from __future__ import annotations

import hashlib
import json
import secrets
from dataclasses import dataclass
from pathlib import Path

from belief.codec import from_fields, to_fields
from belief.files import atomic_path, require_regular_file
from experiments.command_line.arguments import BadArgument
from experiments.search.benchmark.cards import TASKS, Card

COMMITMENTS = TASKS.parent / "commitments.json"
"""Digests of the files of hidden seeds by release."""
_BYTES = 32


@dataclass(frozen=True)
class HiddenSeeds:
    """The content of a file: the ``secret``, 64 hexadecimal digits, gives every task a seed of 128 bits.

    Nobody can guess the secret from the digest of its file, nor the seed from the searches of a submission.
    """

    release: str
    secret: str

    def __post_init__(self) -> None:
        if len(self.secret) != 2 * _BYTES or not set(self.secret) <= set("0123456789abcdef"):
            raise BadArgument(f"a secret has {2 * _BYTES} hexadecimal digits")

    def seed(self, card: Card) -> int:
        """Seed of the searches of a task."""
        return int.from_bytes(hashlib.sha256(f"{self.secret} {card.name} {card.digest}".encode()).digest()[:16])

    @property
    def content(self) -> bytes:
        """The file."""
        return (json.dumps(to_fields(self)) + "\n").encode()

    @property
    def digest(self) -> str:
        """SHA-256 of the file, as ``sha256sum`` prints it."""
        return hashlib.sha256(self.content).hexdigest()

    @classmethod
    def create(cls, path: Path, release: str) -> HiddenSeeds:
        """Write a file with a new secret, which only its owner can read; one that is there stays."""
        made = cls(release, secrets.token_hex(_BYTES))
        with atomic_path(path, only_new=True) as temporary:
            temporary.write_bytes(made.content)
        path.chmod(0o600)
        return made

    @classmethod
    def load(cls, path: Path) -> HiddenSeeds:
        """Read a file; raises BadArgument if it is none, or if its digest is not in the repository."""
        try:
            content = require_regular_file(path, BadArgument).read_bytes()
            found = from_fields(cls, json.loads(content))
        except (ValueError, OSError, RecursionError) as error:
            raise BadArgument(f"{path} holds no hidden seeds: {error}") from error
        committed = json.loads(COMMITMENTS.read_text(encoding="utf-8"))
        if content != found.content or committed.get(found.release) != found.digest:
            raise BadArgument(
                f"{path} is not the file of {found.release!r} whose SHA-256 is in {COMMITMENTS.name}: "
                f"{committed.get(found.release, 'there is none of this release')}, found {found.digest}"
            )
        return found
