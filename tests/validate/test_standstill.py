"""The table of a machine at standstill, from recordings that are simulated here."""

import numpy as np
from tests.pmsm.injection import TIME_STEP, Reluctance, injected, one_axis_a_file
from validate.command import Ended

from validate import standstill

MACHINE = Reluctance()


def written(folder):
    """Write the recordings as the real ones are, with the flux linkage that is true."""
    both = injected("both", (110.0, 200.0), samples=1000, delay=2)
    for file, run in zip(standstill.FILES, [both, *one_axis_a_file(delay=2)], strict=True):
        columns = [run.channels[name] for name in ("u_d", "u_q", "i_d", "i_q")]
        psi = MACHINE.flux(run.stack(("i_d", "i_q")))
        table = np.column_stack([TIME_STEP * np.arange(len(run)), *columns, psi])
        header = "t,Ud,Uq,Id,Iq,Psi_d,Psi_q"
        np.savetxt(folder / file, table, delimiter=",", header=header, comments="")


def test_every_line_is_printed_where_the_command_refuses_too(tmp_path, monkeypatch, capsys):
    refused = Ended(2, "no such file\n", (), 0.0)
    monkeypatch.setattr(standstill, "OUT", tmp_path / "out")
    monkeypatch.setattr(standstill, "identify", lambda *arguments: refused)
    written(tmp_path)
    standstill.main(tmp_path)
    *lines, least = capsys.readouterr().out.splitlines()
    assert [line.split("exit")[0].strip() for line in lines] == list(standstill.SETS)
    assert all("exit status 2: no such file" in line for line in lines)
    assert "omega_el = 0" in (tmp_path / "out" / "study.toml").read_text()
    assert abs(float(least.split(" R ")[1].split()[0]) - MACHINE.resistance) < 0.1
    assert "delay 2.00" in least


def test_a_map_is_compared_up_to_a_constant_and_where_the_axis_moves():
    authors = np.stack([np.linspace(-1.0, 1.0, 5), np.zeros(5)], axis=1)
    assert standstill.apart(authors + 3.0, authors) == "0.000"
    assert standstill.apart(0.9 * authors, authors) == "0.060"
