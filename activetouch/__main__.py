"""``python -m activetouch``: the same as the ``activetouch`` command."""

from importlib import import_module

from activetouch.own_packages import require_own_packages

if __name__ == "__main__":
    require_own_packages("planners", "experiments")  # the working folder comes first in the search path
    import_module("experiments.cli").main()  # by name, because activetouch must not import experiments
