"""MATLAB file in the form of SyR-e's ``fdfq_idiq_n256.mat``."""

import io

from scipy.io import savemat

from penode.pmsm.machine.flux_grid import FluxGrid


def encode(grid: FluxGrid) -> bytes:
    """Return the file: ``Id``, ``Iq`` (A), ``Fd``, ``Fq`` (Vs) and, with pole pairs, ``T`` (Nm).

    Every matrix has i_q along its rows and i_d along its columns, as MATLAB's meshgrid has; the d
    axis is that of the magnet. They stand in the file by themselves, as SyR-e loads them, and in a
    struct ``fdfq_idiq``; ``supported`` beside them is 1 where recordings have been, and
    ``temperatures`` a text that says at which temperature the map is that of the magnets.
    """
    (i_d, i_q), (psi_d, psi_q) = grid.mesh, grid.psi
    maps = {"Id": i_d.T, "Iq": i_q.T, "Fd": psi_d.T, "Fq": psi_q.T}
    if grid.torque is not None:
        maps["T"] = grid.torque.T
    maps["supported"] = grid.supported.T.astype(float)
    content = io.BytesIO()
    text = grid.temperatures.of_map
    savemat(content, {**maps, "fdfq_idiq": maps, "temperatures": text}, do_compression=True)
    return content.getvalue()
