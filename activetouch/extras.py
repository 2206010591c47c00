"""The optional parts of an installation: which packages each extra brings, and an error that names the extra.

>>> extra_of("transformers.models"), extra_of("numpy")
('train', None)
"""

from __future__ import annotations

import sys
from collections.abc import Mapping
from importlib.util import find_spec
from types import MappingProxyType

from belief.errors import MissingPackage, install_command

EXTRAS: Mapping[str, tuple[str, ...]] = MappingProxyType(
    {
        "train": ("torch", "transformers", "onnx", "onnxscript"),
        "rl": ("gymnasium", "stable_baselines3", "torch"),
        "contrib": ("sb3_contrib",),
        "tensorboard": ("tensorboard",),
        "pomdp": ("pomdp_py",),
        "cluster": ("distributed",),
        "meshes": ("trimesh", "collada", "lxml", "networkx"),
        "view": ("rerun",),
        "recorded": ("sklearn",),  # of belief.estimators, and of examples
        "formats": ("pyarrow", "mcap"),  # of examples
    }
)
"""Modules by the extra that installs them."""


def is_installed(module: str) -> bool:
    """Whether a module can be imported."""
    return find_spec(module) is not None


def require_extra(extra: str) -> None:
    """Check that an extra, a key of :data:`EXTRAS`, is installed, before any work."""
    missing = [name for name in EXTRAS[extra] if not is_installed(name)]
    if missing:
        raise missing_package(missing, extra)


def script_needs(extra: str) -> None:
    """:func:`require_extra` for the first line of a script, which then ends with the message and no traceback."""
    try:
        require_extra(extra)
    except MissingPackage as error:
        sys.exit(str(error))


def missing_package(modules: list[str], extra: str) -> MissingPackage:
    """The error to raise where modules of an extra are missing."""
    what = " and ".join(filter(None, [", ".join(modules[:-1]), modules[-1]]))
    return MissingPackage(f"{what} {'is' if len(modules) == 1 else 'are'} not installed: {install_command(extra)}")


def extra_of(module: str) -> str | None:
    """The extra that installs a module; None if it is of no extra."""
    top = module.partition(".")[0]
    return next((extra for extra, modules in EXTRAS.items() if top in modules), None)
