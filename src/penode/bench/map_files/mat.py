"""Reader of flux maps in MATLAB files up to version 7."""

import zlib
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.io import loadmat
from scipy.io.matlab import MatReadError

from penode.errors import InputError


def read(path: Path) -> dict[str, NDArray[Any]]:
    """Read the numeric variables of a MATLAB file.

    Parameters
    ----------
    path : Path
        File to read.

    Returns
    -------
    dict of str to ndarray
        Variables by name; the numeric fields of a struct are named after the field alone where no
        variable has that name. Vectors have one axis, as their length says. Of a machine as SyR-e
        saves it (``motorModel``) the map of currents and fluxes, its d axis along the magnets.

    Raises
    ------
    InputError
        If the file is no MATLAB file of version 7 or older.
    OSError
        If the file cannot be opened.
    """
    with path.open("rb") as file:
        has_header = file.read(6) == b"MATLAB"
    try:
        if not has_header:
            raise ValueError("no MATLAB header")
        variables = loadmat(path, struct_as_record=False, squeeze_me=True)
    except NotImplementedError as error:
        raise InputError(
            f"{path}: a MATLAB file of version 7.3; save it with '-v7' instead."
        ) from error
    except (ValueError, TypeError, IndexError, MatReadError, OSError, zlib.error) as error:
        raise InputError(f"{path}: not a MATLAB file; save it from MATLAB with '-v7'.") from error
    model = variables.get("motorModel")
    if "FluxMap_dq" in getattr(model, "_fieldnames", []):
        return _of_syre(model)
    arrays: dict[str, NDArray[Any]] = {}
    for struct in variables.values():
        fields = getattr(struct, "_fieldnames", [])
        arrays |= {field: np.asarray(getattr(struct, field)) for field in fields}
    arrays |= {name: np.asarray(value) for name, value in variables.items() if name[0] != "_"}
    return {name: values for name, values in arrays.items() if values.dtype.kind in "biufc"}


def _of_syre(model: Any) -> dict[str, NDArray[Any]]:
    """Return SyR-e's map; synchronous reluctance axes have d where the inductance is largest."""
    grid = model.FluxMap_dq
    i_d, i_q, psi_d, psi_q = (np.asarray(getattr(grid, name)) for name in ("Id", "Iq", "Fd", "Fq"))
    if getattr(getattr(model, "data", None), "axisType", "PM") == "SR":
        i_d, i_q, psi_d, psi_q = -i_q, i_d, -psi_q, psi_d
    return {"i_d": i_d, "i_q": i_q, "psi_d": psi_d, "psi_q": psi_q}
