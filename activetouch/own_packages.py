"""A user's own folders that bear the names of the packages ``belief``, ``planners`` and ``experiments``.

``python -m activetouch`` searches the working folder first, so a folder ``planners/`` there hides the package.
"""

from __future__ import annotations

import sys
from importlib.machinery import PathFinder
from pathlib import Path

_ROOT = Path(__file__).resolve().parent.parent
_NAMES = ("belief", "planners", "experiments")


class NameInTheWay(ImportError):
    """A folder or file of the user's hides a package of activetouch."""


def hidden_by() -> dict[str, Path]:
    """Packages that Python would not import from this installation, and what it would import instead.

    >>> hidden_by()
    {}
    """
    found = {}
    for name in _NAMES:
        spec = PathFinder.find_spec(name)
        if spec is None:  # an editable installation, whose finder comes last
            continue
        place = Path(spec.origin or next(iter(spec.submodule_search_locations or [str(_ROOT / name)]))).resolve()
        place = place.parent if place.name == "__init__.py" else place
        if place != _ROOT / name:
            found[name] = place
    return found


def make_way() -> None:
    """Take the working folder out of the search path where it hides a package, and say so on standard error."""
    if found := hidden_by():
        sys.path[:] = [place for place in sys.path if Path(place or ".").resolve() != Path.cwd()]
        which = " and ".join(map(str, found.values()))
        print(f"activetouch: {which}: not used, because a package of activetouch has this name", file=sys.stderr)
    require_own_packages()


def require_own_packages(*names: str) -> None:
    """Check that packages are those of this installation.

    Args:
        names: the packages to check; all by default.

    Raises:
        NameInTheWay: a folder or file of the user's comes first.
    """
    for name, place in hidden_by().items():
        if not names or name in names:
            raise NameInTheWay(
                f"{place} hides the package {name!r} of activetouch in {_ROOT}: rename it, or start Python elsewhere; "
                "the command `activetouch` works in any folder"
            )
