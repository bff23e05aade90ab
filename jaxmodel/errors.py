"""The two ways a command ends without a result."""


class InputError(ValueError):
    """Bad input: one sentence naming the file, key or row and what was expected. The command exits with 2."""


class RunError(RuntimeError):
    """The input was sound but the run failed: one sentence saying why. The command exits with 1."""
