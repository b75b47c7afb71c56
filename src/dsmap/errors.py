"""The one error that means "your input is wrong", as opposed to "dsmap is wrong", and the warning that it may be."""


class InputError(Exception):
    """Bad input from outside: a missing file, a wrong size, a foreign checkpoint.

    The message is one sentence that names the file, the value found and what was expected.
    The command line prints it without a traceback and exits with code 2.
    """


class InputWarning(UserWarning):
    """Input that can be worked with, though less well; the message says why, and what is done."""


class WriteError(InputError):
    """What was to be written could not be: a full disk, a folder without permission."""
