"""Leaves out doctests of modules whose packages this platform does not have."""

from importlib.util import find_spec

collect_ignore = [] if find_spec("pomdp_py") else ["planners/pomdp_py_adapter.py"]
