"""A user's own folders that bear the names of the packages ``belief``, ``planners`` and ``experiments``."""

from __future__ import annotations

from importlib.machinery import PathFinder
from pathlib import Path

_ROOT = Path(__file__).resolve().parent.parent


class NameInTheWay(ImportError):
    """A folder or file of the user hides a package of activetouch."""


def require_own_packages(*names: str) -> None:
    """Check that packages are those of this installation."""
    for name in names:
        spec = PathFinder.find_spec(name)
        if spec is None:  # an editable installation, whose finder comes last
            continue
        place = Path(spec.origin or next(iter(spec.submodule_search_locations or [str(_ROOT / name)]))).resolve()
        place = place.parent if place.name == "__init__.py" else place
        if place != _ROOT / name:
            raise NameInTheWay(
                f"{place} hides the package {name!r} of activetouch in {_ROOT}: rename it, or start Python elsewhere; "
                "the command `activetouch` works in any folder"
            )
