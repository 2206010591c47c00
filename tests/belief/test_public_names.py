"""Everything that the API reference shows of belief has an example."""

import doctest
import importlib
import inspect
from dataclasses import is_dataclass

import pytest

# The modules of docs/generate/pages.py, and three beside them. Other modules are shown by their tests.
PARTS = "arrangement bayes calibration estimators metrics observation_model observation_model.selection"
PARTS += " policy_state statistics synthetic touch_batch"
MODULES = ["belief", *(f"belief.{name}" for name in PARTS.split())]


def is_shown_elsewhere(kind):
    """Protocols, exceptions and records without methods are shown by what follows, raises or makes them."""
    is_record = is_dataclass(kind) or issubclass(kind, tuple)
    methods = [name for name, member in vars(kind).items() if callable(member) and not name.startswith("_")]
    return issubclass(kind, Exception) or getattr(kind, "_is_protocol", False) or (is_record and not methods)


def public_members():
    """Functions and classes that the modules export or define, and the modules that define them."""
    for module in map(importlib.import_module, MODULES):
        for name in getattr(module, "__all__", vars(module)):
            member = getattr(module, name)
            is_own = hasattr(module, "__all__") or getattr(member, "__module__", None) == module.__name__
            if name.startswith("_") or not is_own:
                continue
            if inspect.isfunction(member) or (inspect.isclass(member) and not is_shown_elsewhere(member)):
                yield importlib.import_module(member.__module__), name


@pytest.mark.parametrize(("module", "name"), list(public_members()), ids=lambda part: getattr(part, "__name__", part))
def test_every_public_function_and_class_has_an_example(module, name):
    found = doctest.DocTestFinder().find(getattr(module, name), name, globs={})
    of_module = doctest.DocTestParser().get_examples(module.__doc__ or "")
    assert any(test.examples for test in found) or any(name in example.source for example in of_module)
