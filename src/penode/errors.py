"""The two ways penode refuses: the input is unusable, or the data cannot answer."""


class InputError(ValueError):
    """Bad input or usage, in one sentence: what came, what was wanted, how to mend it.

    The command line prints the sentence and ends with exit status 2.
    """
