"""The one error that means "your input is wrong", as opposed to "dsmap is wrong", and the warning that it may be."""


class InputError(Exception):
    """Bad input from outside: a missing file, a wrong size, a foreign checkpoint.

    The message is one sentence that names the file, the value found and what was expected.
    The command line prints it without a traceback and exits with code 2.
    """


class WriteError(InputError):
    """What was to be written could not be: a full disk, a folder without permission.

    Args:
        message: the sentence.
        files: names of the files that are missing now, or as old as before.
        reason: the system's words.
    """

    def __init__(self, message: str, files: tuple[str, ...] = (), reason: str = ""):
        super().__init__(message)
        self.files, self.reason = files, reason


class InputWarning(UserWarning):
    """Input that can be worked with, though less well; the message says why, and what is done."""
