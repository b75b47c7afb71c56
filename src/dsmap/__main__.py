"""`python -m dsmap`: the command line, where the `dsmap` program is not on the path."""

from importlib import import_module

if __name__ == "__main__":
    # By name: everything under src/dsmap stands below the tools, this one line excepted.
    import_module("dsmap.tools.entry").main()
