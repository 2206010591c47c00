"""Everything public shows how it is used."""

import doctest
import importlib
import inspect
import pkgutil
from dataclasses import is_dataclass

import pytest

import belief


def modules():
    """All of belief's."""
    found = [importlib.import_module(info.name) for info in pkgutil.walk_packages(belief.__path__, "belief.")]
    return [belief, *found]


def is_shown_elsewhere(kind):
    """Protocols, exceptions and records without methods are shown by what follows, raises or makes them."""
    is_record = is_dataclass(kind) or issubclass(kind, tuple)
    methods = [name for name, member in vars(kind).items() if callable(member) and not name.startswith("_")]
    return issubclass(kind, Exception) or getattr(kind, "_is_protocol", False) or (is_record and not methods)


def public_members():
    """Functions and classes, and the names of their modules."""
    for module in modules():
        for name, member in vars(module).items():
            if getattr(member, "__module__", None) != module.__name__ or name.startswith("_"):
                continue
            if inspect.isfunction(member) or (inspect.isclass(member) and not is_shown_elsewhere(member)):
                yield module, name


@pytest.mark.parametrize(("module", "name"), list(public_members()), ids=lambda part: getattr(part, "__name__", part))
def test_every_public_function_and_class_has_an_example(module, name):
    found = doctest.DocTestFinder().find(getattr(module, name), name, globs={})
    of_module = doctest.DocTestParser().get_examples(module.__doc__ or "")
    assert any(test.examples for test in found) or any(name in example.source for example in of_module)
