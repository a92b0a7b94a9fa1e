"""MATLAB file for look-up tables in Simulink and Simscape."""

import io
from collections.abc import Mapping
from typing import Any

from scipy.io import savemat


def encode(variables: Mapping[str, Any]) -> bytes:
    """Return the file of variables by name."""
    content = io.BytesIO()
    savemat(content, variables, do_compression=True)
    return content.getvalue()
