"""References to Python objects on the command line: ``module:attribute`` or a registry entry, with settings.

    mine:decider                    the object ``decider`` of the module ``mine``
    mine:TwoLooks(touches=4)        the result of calling its class or function ``TwoLooks``
    point_based(rounds=[200, 400])  an entry of a registry, with settings

The module is searched among installed modules first, then in the working folder, whose files therefore hide nothing
that is installed. Settings are Python literals.
"""

from __future__ import annotations

import ast
import importlib
import inspect
import re
import sys
import traceback
from collections.abc import Mapping
from dataclasses import dataclass, field
from importlib.metadata import distributions, entry_points
from pathlib import Path
from types import TracebackType
from typing import Any

from belief.errors import ActiveTouchError, CodeFailed, UnknownName
from belief.files import OWN_PACKAGES, is_installed, is_standard


class BadReference(ActiveTouchError, ValueError):
    """A reference is malformed, or there is no such object."""


@dataclass(frozen=True)
class Reference:
    """A parsed reference: its name, the keyword arguments in brackets after it, and whether there are brackets.

    >>> Reference.parse("mine:TwoLooks(touches=4)")
    Reference(name='mine:TwoLooks', settings={'touches': 4}, is_called=True)
    """

    name: str
    settings: Mapping[str, Any] = field(default_factory=dict)
    is_called: bool = False

    @classmethod
    def parse(cls, text: str) -> Reference:
        """Parse ``name``, ``name(key=literal, ...)``, or either with ``module:`` before it.

        A hyphen in the name of an entry counts as an underscore, as in options:

        >>> Reference.parse("information-gain").name
        'information_gain'
        """
        name, bracket, rest = text.partition("(")
        name = name.strip() if ":" in name else name.strip().replace("-", "_")
        module, colon, attribute = name.rpartition(":")
        if not all(part.isidentifier() for part in [*attribute.split("."), *(module.split(".") if colon else ())]):
            raise BadReference(f"{text!r} is not a name; write name, module:attribute, or either with (key=value, ...)")
        try:
            call = ast.parse(f"f({rest}" if bracket else "f()", mode="eval").body
            if not isinstance(call, ast.Call) or not isinstance(call.func, ast.Name) or call.args:
                raise ValueError("settings need names, in one pair of brackets")
            settings = {str(keyword.arg): ast.literal_eval(keyword.value) for keyword in call.keywords}
            if None in (keyword.arg for keyword in call.keywords):
                raise ValueError("settings cannot be unpacked with **")
            if len(settings) < len(call.keywords):
                raise ValueError("a setting is given twice")
        except (SyntaxError, ValueError) as error:
            raise BadReference(
                f"{text!r} cannot be read: {error}. Settings are literals by name, such as {name}(touches=4)"
            ) from error
        return cls(name, settings, bool(bracket))

    @property
    def is_users(self) -> bool:
        """Whether it refers to an attribute of a module rather than to an entry of a registry."""
        return ":" in self.name

    def load(self) -> Any:
        """The attribute of the module."""
        module_name, _, attribute = self.name.rpartition(":")
        here = str(Path.cwd())
        look_in(here)
        try:
            with ForeignCode(f"importing {module_name}, for {self.name}"):
                found: Any = importlib.import_module(module_name)
        except CodeFailed:
            raise
        except ModuleNotFoundError as error:
            if error.name != module_name.split(".")[0] and error.name != module_name:
                raise BadReference(f"{self.name}: importing {module_name} failed: {error}") from error
            raise BadReference(
                f"{self.name}: there is no module {module_name!r}; neither is {module_name.replace('.', '/')}.py in "
                f"{here}, nor is it installed"
            ) from error
        except Exception as error:
            raise BadReference(f"{self.name}: importing {module_name} failed: {error!r}") from error
        own, used = Path(here, *module_name.split(".")).with_suffix(".py"), getattr(found, "__file__", None)
        if own.exists() and (used is None or Path(used).resolve() != own.resolve()):
            raise BadReference(f"{self.name}: {own} is hidden by {used or 'a module of Python'}: rename it")
        for part in attribute.split("."):
            if not hasattr(found, part):
                raise UnknownName(f"attribute of {module_name}", part, [n for n in dir(found) if not n.startswith("_")])
            found = getattr(found, part)
        return found


@dataclass(frozen=True)
class ForeignCode:
    """Context in which every exception of a user's code becomes CodeFailed, with its line in place of all frames.

    ``where`` says what was being done, as a note of the error. Ctrl-C and faults of this project pass unchanged.

    >>> with ForeignCode():
    ...     exec("import sys; sys.exit(0)")
    Traceback (most recent call last):
    ...
    belief.errors.CodeFailed: <string>, line 1:
    SystemExit: 0
    """

    where: str = ""

    def __enter__(self) -> None:
        """Nothing is needed."""

    def __exit__(self, kind: object, error: BaseException | None, trace: TracebackType | None) -> None:
        """Raise CodeFailed in place of the error."""
        if error is None or isinstance(error, KeyboardInterrupt):
            return
        failed: BaseException = error
        if not isinstance(error, ActiveTouchError):
            calls = list(zip(traceback.walk_tb(trace), traceback.extract_tb(trace), strict=True))
            own = [at for (frame, _), at in calls if _is_foreign(frame.f_globals.get("__name__", ""), at.filename)]
            if isinstance(error, Exception) and not own:
                return
            at = own[-1] if own else calls[-1][1]
            line = f"{at.filename}, line {at.lineno}: {at.line}".rstrip()
            failed = CodeFailed(f"{line}\n{type(error).__name__}: {error}")
        if self.where:
            failed.add_note(self.where)
        if failed is not error:
            raise failed from error


def _is_foreign(module: str, file: str) -> bool:
    """Whether code is of neither this project nor Python, and not installed unless it is offered to this project."""
    top = module.partition(".")[0]
    if top in OWN_PACKAGES or is_standard(module):
        return False
    offered = (entry for found in distributions() for entry in found.entry_points)
    names = {re.split("[.:]", entry.value)[0] for entry in offered if entry.group.startswith("activetouch.")}
    return not is_installed(file) or top in names


def look_in(folder: str) -> None:
    """Put a folder last in the module search path, where it hides no installed module."""
    if folder not in sys.path:
        sys.path.append(folder)
    importlib.invalidate_caches()


def build(
    name: str, found: Any, settings: Mapping[str, Any], offered: Mapping[str, Any], is_called: bool = True
) -> Any:
    """Call a class or function with settings and offered values; return any other object unchanged."""
    if not inspect.isclass(found) and not inspect.isroutine(found):
        if is_called:
            raise BadReference(f"{name} is a {type(found).__name__} and takes no settings; write {name}")
        return found
    parameters = inspect.signature(found).parameters
    takes_all = any(p.kind is inspect.Parameter.VAR_KEYWORD for p in parameters.values())
    named = [p.name for p in parameters.values() if p.kind in (p.POSITIONAL_OR_KEYWORD, p.KEYWORD_ONLY)]
    choices = [parameter for parameter in named if parameter not in offered]
    for key in settings:
        if not takes_all and key not in named:
            raise BadReference(f"{name} has no setting {key!r}; it has {', '.join(choices) or 'none'}")
    arguments = {key: value for key, value in offered.items() if key in named} | dict(settings)
    missing = [n for n in named if parameters[n].default is inspect.Parameter.empty and n not in arguments]
    if missing:
        raise BadReference(f"{name} needs {', '.join(missing)}; write {name}({', '.join(f'{m}=...' for m in missing)})")
    with ForeignCode(f"{name} cannot be made"):
        return found(**arguments)


def find(what: str, text: str, registry: Mapping[str, Any], group: str) -> tuple[Any, Reference]:
    """Find the object of a reference: a registry entry, an attribute of a module, or an entry point."""
    if text in registry:  # registry names may hold any characters
        return registry[text], Reference(text)
    reference = Reference.parse(text)
    if reference.is_users:
        return reference.load(), reference
    if reference.name in registry:
        return registry[reference.name], reference
    offered = {entry.name: entry.value for entry in entry_points(group=group)}
    if reference.name in offered:
        return Reference.parse(offered[reference.name]).load(), reference
    raise UnknownName(what, reference.name, [*registry, *offered])
