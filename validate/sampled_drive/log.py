"""What a drive writes down, and its file."""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np


@dataclass(frozen=True)
class Log:
    """A row a sample.

    Attributes
    ----------
    time : ndarray, shape (time,)
        s.
    voltage, current : ndarray of complex, shape (time,)
        d + j q, in V and A.
    speed, angle : ndarray, shape (time,)
        Electrical, in rad/s and rad; the angle is not wrapped.
    link : ndarray, shape (time,)
        Voltage of the dc link as the drive knows it, in V.
    without : tuple of str
        Columns that the file lacks.
    turn : float
        What one turn is in the file's column of the angle.
    """

    time: np.ndarray
    voltage: np.ndarray
    current: np.ndarray
    speed: np.ndarray
    angle: np.ndarray
    link: np.ndarray
    without: tuple[str, ...] = ()
    turn: float = 2 * np.pi

    def rows(self, kept: slice | np.ndarray) -> "Log":
        """Return some rows."""
        columns = ("time", "voltage", "current", "speed", "angle", "link")
        return replace(self, **{name: getattr(self, name)[kept] for name in columns})

    def means(self, count: int) -> "Log":
        """Return means of as many rows each, stamped with the time of the first."""
        whole = len(self.time) // count * count

        def mean(column: np.ndarray) -> np.ndarray:
            return column[:whole].reshape(-1, count).mean(1)

        names = ("voltage", "current", "speed", "angle", "link")
        averaged = {name: mean(getattr(self, name)) for name in names}
        return replace(self, time=self.time[:whole:count], **averaged)

    def turned(self, angle: np.ndarray) -> "Log":
        """Return the log with voltages and currents turned by angles in rad."""
        turn = np.exp(1j * angle)
        return replace(self, voltage=turn * self.voltage, current=turn * self.current)

    def write(self, path: Path) -> None:
        """Write CSV with the columns that penode reads unasked, the angle within a turn."""
        u, i = self.voltage, self.current
        columns = {
            "t": self.time,
            "u_d": u.real,
            "u_q": u.imag,
            "i_d": i.real,
            "i_q": i.imag,
            "omega_el": self.speed,
            "theta_el": self.turn * np.mod(self.angle / (2 * np.pi), 1),
            "u_dc": self.link,
        }
        columns = {name: some for name, some in columns.items() if name not in self.without}
        rows = np.stack(list(columns.values()), axis=-1)
        np.savetxt(path, rows, "%.8g", ",", header=",".join(columns), comments="")
