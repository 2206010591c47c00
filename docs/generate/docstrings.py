"""Docstrings as the site shows them: what Sphinx would read as a reference becomes code, and doctests become blocks."""

from __future__ import annotations

import re
from typing import Any

from griffe import Extension

_ROLE = re.compile(r":(?:class|func|mod|meth|data|attr|exc):`~?([^`]+)`")
_DOCTEST = re.compile(r"^( *)>>> .*\n?(?:^\1.*\S.*\n?)*", flags=re.M)


def readable(text: str) -> str:
    r"""A docstring without Sphinx roles, with its doctests fenced.

    >>> readable("See :class:`~belief.Belief`.")
    'See `belief.Belief`.'
    >>> readable("x\n\n>>> 1\n1")
    'x\n\n```pycon\n>>> 1\n1\n```'
    """
    text = _ROLE.sub(r"`\1`", text)
    text = re.sub(r"^( *)Example:$", r"\1Examples:", text, flags=re.M)
    if re.search(r"^ *Examples:$", text, flags=re.M):
        return text  # a section that the parser of docstrings knows
    return _DOCTEST.sub(lambda found: f"{found[1]}```pycon\n{found[0].rstrip()}\n{found[1]}```", text)


class Readable(Extension):
    """Changes every docstring before it is parsed."""

    def on_object(self, *, obj: Any, **kwargs: Any) -> None:
        """See :class:`griffe.Extension`."""
        if obj.docstring:
            obj.docstring.value = readable(obj.docstring.value)
