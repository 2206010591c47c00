"""``python -m activetouch``: the same as the ``activetouch`` command."""

from importlib import import_module

if __name__ == "__main__":
    import_module("experiments.cli").main()  # by name, because activetouch must not import experiments
