"""The log of a simulated drive, and its file."""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

#: Sampling period in s, and samples at the start that a log leaves out.
TIME_STEP = 1e-4
SETTLING = 300


@dataclass(frozen=True)
class DriveLog:
    """What a drive wrote down, a row a sample.

    Attributes
    ----------
    current, voltage : ndarray of complex, shape (time,)
        In the frame of the rotor, d + j q, in A and V.
    speed, angle : ndarray, shape (time,)
        Electrical, in rad/s and rad.
    link : float
        Voltage of the DC link, in V.
    """

    current: np.ndarray
    voltage: np.ndarray
    speed: np.ndarray
    angle: np.ndarray
    link: float

    def after(self, samples: int) -> "DriveLog":
        """Return the log without its first samples."""
        return replace(
            self,
            current=self.current[samples:],
            voltage=self.voltage[samples:],
            speed=self.speed[samples:],
            angle=self.angle[samples:],
        )

    def write(self, path: Path) -> None:
        """Write the log as CSV with the columns that penode reads unasked."""
        time = TIME_STEP * np.arange(len(self.speed))
        u, i, link = self.voltage, self.current, np.full(len(time), self.link)
        columns = (time, u.real, u.imag, i.real, i.imag, self.speed, np.unwrap(self.angle), link)
        names = "t,u_d,u_q,i_d,i_q,omega_el,theta_el,u_dc"
        np.savetxt(path, np.stack(columns, axis=-1), "%.9g", ",", header=names, comments="")
