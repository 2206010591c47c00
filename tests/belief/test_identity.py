"""The digest of what defines an object changes with its source, and with nothing else."""

import importlib
import linecache
import sys

import pytest

from belief.files import source_digest

SOURCE = "class Base:\n    edge = 1\n"
CHILD = "from own_base import Base\n\nclass Child(Base):\n    touches: int = 2\n\ndef work():\n    return 1\n"


@pytest.fixture
def modules(tmp_path, monkeypatch):
    """A folder for modules of a user's own, and a function that writes and imports one."""
    monkeypatch.syspath_prepend(tmp_path)

    def module(name, source):
        (tmp_path / f"{name}.py").write_text(source)
        sys.modules.pop(name, None)
        importlib.invalidate_caches()
        return importlib.import_module(name)

    yield module
    for name in ("own_base", "own_child"):
        sys.modules.pop(name, None)


def test_an_edited_module_gives_another_digest_and_an_equal_one_the_same(modules):
    modules("own_base", SOURCE)
    first = source_digest(modules("own_child", CHILD).Child())
    assert source_digest(modules("own_child", CHILD).Child) == first
    assert source_digest(modules("own_child", CHILD.replace("= 2", "= 6")).Child()) != first


def test_an_edited_base_class_gives_another_digest(modules):
    modules("own_base", SOURCE)
    first = source_digest(modules("own_child", CHILD).Child)
    modules("own_base", SOURCE.replace("1", "2"))
    assert source_digest(modules("own_child", CHILD).Child) != first


def test_a_function_and_a_class_of_one_module_differ(modules):
    modules("own_base", SOURCE)
    child = modules("own_child", CHILD)
    assert source_digest(child.work) != source_digest(child.Child)


def test_without_a_source_file_the_source_text_is_taken_and_without_it_the_object():
    def made(text):
        space = {"__name__": "typed_in"}
        source = f"def decide():\n    return {text}\n"
        linecache.cache["<typed>"] = (len(source), None, source.splitlines(True), "<typed>")
        exec(compile(source, "<typed>", "exec"), space)
        return space["decide"]

    first = source_digest(made("2"))
    assert source_digest(made("2")) == first != source_digest(made("6"))
    space = {"__name__": "typed_in"}
    exec("class Decider:\n    touches = 2\n", space)
    assert source_digest(space["Decider"]) == source_digest(space["Decider"]()) != first
