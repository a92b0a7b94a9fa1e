"""Reader of flux maps in NumPy archives."""

import zipfile
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from penode.errors import InputError


def read(path: Path) -> dict[str, NDArray[Any]]:
    """Read the numeric arrays of a NumPy archive.

    Parameters
    ----------
    path : Path
        File to read; nothing pickled is loaded.

    Returns
    -------
    dict of str to ndarray
        Arrays by name.

    Raises
    ------
    InputError
        If the file is no archive of numeric arrays.
    OSError
        If the file cannot be opened.
    """
    try:
        with np.load(path, allow_pickle=False) as archive:
            arrays = {name: archive[name] for name in archive.files}
    except (ValueError, AttributeError, zipfile.BadZipFile, EOFError) as error:
        raise InputError(
            f"{path}: not a NumPy archive of numbers; write it with numpy.savez."
        ) from error
    return {name: values for name, values in arrays.items() if values.dtype.kind in "biufc"}
