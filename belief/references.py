"""Objects of a user's own, named on a command line: ``module:attribute``, with settings where it is called.

    mine:decider                    an object that the module mine has
    mine:TwoLooks(touches=4)        what its class or function TwoLooks returns for these settings
    point_based(rounds=2)           an entry of a registry, with settings

The module is looked up as ``python -m`` does: in the working folder first, then among what is installed. Settings are
Python literals, so that a name can be written down, sent to another process and resolved there.
"""

from __future__ import annotations

import ast
import importlib
import inspect
import sys
from collections.abc import Mapping
from dataclasses import dataclass, field
from importlib.metadata import entry_points
from pathlib import Path
from typing import Any

from belief.errors import ActiveTouchError, UnknownName


class BadReference(ActiveTouchError, ValueError):
    """The name of an object cannot be read, or does not lead to one."""


@dataclass(frozen=True)
class Reference:
    """A name with settings, taken apart.

    Attributes:
        name: ``attribute``, or ``module:attribute``.
        settings: keyword arguments that stand in brackets after it.
        is_called: whether there are brackets.

    >>> Reference.parse("mine:TwoLooks(touches=4)")
    Reference(name='mine:TwoLooks', settings={'touches': 4}, is_called=True)
    """

    name: str
    settings: Mapping[str, Any] = field(default_factory=dict)
    is_called: bool = False

    @classmethod
    def parse(cls, text: str) -> Reference:
        """The parts of ``name``, ``name(key=literal, ...)``, or either with ``module:`` before it.

        Raises:
            BadReference: the text is none of these.
        """
        name, bracket, rest = text.partition("(")
        module, colon, attribute = name.strip().rpartition(":")
        if not all(part.isidentifier() for part in [*attribute.split("."), *(module.split(".") if colon else ())]):
            raise BadReference(f"{text!r} is no name; write name, module:attribute, or either with (key=value, ...)")
        try:
            call = ast.parse(f"f({rest}" if bracket else "f()", mode="eval").body
            if not isinstance(call, ast.Call) or call.args:
                raise ValueError("settings have names")
            settings = {str(keyword.arg): ast.literal_eval(keyword.value) for keyword in call.keywords}
            if None in (keyword.arg for keyword in call.keywords):
                raise ValueError("settings cannot be unpacked with **")
        except (SyntaxError, ValueError) as error:
            raise BadReference(
                f"{text!r} cannot be read: {error}. Settings are literals by name, such as {name.strip()}(touches=4)"
            ) from error
        return cls(name.strip(), settings, bool(bracket))

    @property
    def is_users(self) -> bool:
        """Whether it names an attribute of a module, not an entry of a registry."""
        return ":" in self.name

    def load(self) -> Any:
        """The attribute of the module, as it stands there.

        Raises:
            BadReference: there is no such module or attribute, or importing the module fails.
        """
        module_name, _, attribute = self.name.rpartition(":")
        here = str(Path.cwd())
        look_in(here)
        try:
            found: Any = importlib.import_module(module_name)
        except ModuleNotFoundError as error:
            if error.name != module_name.split(".")[0] and error.name != module_name:
                raise BadReference(f"{self.name}: importing {module_name} failed: {error}") from error
            raise BadReference(
                f"{self.name}: there is no module {module_name!r}; neither is {module_name.replace('.', '/')}.py in "
                f"{here}, nor is it installed"
            ) from error
        except Exception as error:
            raise BadReference(f"{self.name}: importing {module_name} failed: {error!r}") from error
        for part in attribute.split("."):
            if not hasattr(found, part):
                raise UnknownName(f"attribute of {module_name}", part, [n for n in dir(found) if not n.startswith("_")])
            found = getattr(found, part)
        return found

    def make(self, **offered: Any) -> Any:
        """The object itself: classes and functions are called with the settings, other objects are returned.

        Args:
            offered: values for parameters of these names which the settings do not give, where there are any.

        Raises:
            BadReference: as :meth:`load`; or settings do not fit.
        """
        return build(self.name, self.load(), self.settings, offered, self.is_called)


def look_in(folder: str) -> None:
    """Have modules of a folder found before all others.

    >>> look_in(str(Path.cwd()))
    >>> str(Path.cwd()) in sys.path
    True
    """
    if folder not in sys.path:
        sys.path.insert(0, folder)
    importlib.invalidate_caches()


def build(
    name: str, found: Any, settings: Mapping[str, Any], offered: Mapping[str, Any], is_called: bool = True
) -> Any:
    """Call a class or function with settings, and with what is offered for its other parameters.

    Args:
        name: what messages call it.
        found: a class, a function, or a finished object.
        settings: keyword arguments that were asked for.
        offered: values for parameters of these names which ``settings`` do not give; the rest is left out.
        is_called: whether it was asked for with brackets.

    Raises:
        BadReference: a setting is unknown or missing, or settings are given for a finished object.

    >>> build("power", pow, {"exp": 3}, {"base": 2, "colour": "red"})
    8
    """
    if not inspect.isclass(found) and not inspect.isroutine(found):
        if is_called:
            raise BadReference(f"{name} is a finished {type(found).__name__}, and takes no settings; write {name}")
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
    return found(**arguments)


def find(what: str, text: str, registry: Mapping[str, Any], group: str) -> tuple[Any, Reference]:
    """What a name leads to: an entry of a registry, an attribute of a module, or what an installed package offers.

    Args:
        what: is looked for, in a word or two, for messages.
        text: the name, with settings where wanted.
        registry: the known ones.
        group: of entry points, whose names come after those of the registry.

    Returns:
        What was found, and the name taken apart; nothing is called yet.

    Raises:
        UnknownName: there is none of that name; the message suggests the nearest.
        BadReference: the text cannot be read, or its module cannot be imported.

    >>> find("fruit", "apple(ripe=True)", {"apple": 3}, "no.such.group")
    (3, Reference(name='apple', settings={'ripe': True}, is_called=True))
    """
    if text in registry:  # a name there need not be a word
        return registry[text], Reference(text)
    reference = Reference.parse(text)
    if reference.is_users:
        return reference.load(), reference
    if reference.name in registry:
        return registry[reference.name], reference
    offered = entry_point_names(group)
    if reference.name in offered:
        return Reference.parse(offered[reference.name]).load(), reference
    raise UnknownName(what, reference.name, [*registry, *offered])


def entry_point_names(group: str) -> dict[str, str]:
    """What installed packages offer under an entry-point group: ``module:attribute`` by name.

    >>> entry_point_names("console_scripts")["activetouch"]
    'experiments.cli:main'
    """
    return {entry.name: entry.value for entry in entry_points(group=group)}
