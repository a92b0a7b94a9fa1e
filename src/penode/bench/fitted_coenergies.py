"""Coenergies fitted to published flux maps; ``benchmarks/fit_machines.py`` derives every number.

The maps themselves are not part of the project. Errors are rms over the points of a map, of one
component of psi and of the vector, in per cent of psi_PM.
"""

from math import radians

from penode.bench.coenergies import HarmonicCoenergy

_Terms = tuple[tuple[int, int, int, float], ...]


def _terms(table: str) -> _Terms:
    """Return the terms (n, m, k, c) of a `HarmonicCoenergy` from a table of these numbers."""
    words = table.split()
    rows = zip(*(words[k::4] for k in range(4)), strict=True)
    return tuple((int(n), int(m), int(k), float(c)) for n, m, k, c in rows)


def _assumed_harmonics(magnet_flux: float, m: int) -> _Terms:
    """Return orders 6, 12 and 18 for a map that has none, sized by psi_PM in Vs.

    They are invented: 0.4 to 0.6, 0.15 to 0.25 and 0.05 to 0.08 % of psi_PM at no current, 1.4 to
    2 times that on average at the current limit; the higher m, the later they grow.
    """
    shares = ((6, 1.5e-3, 12e-3), (12, -5e-4, -5e-3), (18, 2e-4, 1.6e-3))
    return tuple(
        (n, power, 0, magnet_flux * share)
        for n, steady, growing in shares
        for power, share in ((1, steady), (m, growing / m))
    )


#: FEM of an interior-magnet machine, angle-resolved, currents scaled by 3 to a 300 A machine.
#: Source: github.com/usemac/pmsm_dev, MIT. Covered: the disc of 300 A, all angles. Error 0.19 %
#: (vector 0.27 %) over all angles; the mean 0.16 %, order 6 leaves 0.05 of 0.33 mVs, order 12 0.013
#: of 0.064 mVs, order 18 0.006 of 0.014 mVs. Its cogging torque (0.4 Nm after scaling) is left out.
COMSOL_IPM = HarmonicCoenergy(
    scale_current=200.0,
    magnet_current=150.0,
    leakage_d=3.388e-05,
    leakage_q=6.2322e-05,
    terms=_terms("""
        0 0 0 0.028207        0 0 1 0.0012314       0 0 2 0.003493        0 1 0 0.028266
        0 1 2 -0.0061287      0 2 0 0.0015486       0 2 2 0.00089733      0 3 0 -0.0005244
        0 3 2 0.0011883       0 4 1 -2.6843e-07     6 0 1 -2.9453e-05     6 1 0 0.00013451
        6 1 1 -0.00033128     6 1 2 0.00030608      6 2 1 0.00010855      6 2 2 -0.00026565
        6 3 0 -3.4402e-05     6 6 0 -0.00040448     6 6 1 0.0010199       6 7 0 0.00032998
        6 7 1 -0.0005508      6 9 0 1.4621e-05      12 5 0 -1.6653e-05    12 6 2 2.1549e-05
        12 8 0 -0.00027337    12 8 1 0.0010921      12 8 2 -0.00092133    12 10 0 -0.00026253
        12 10 1 0.0012223     12 10 2 -0.0011482    12 12 1 0.00012803    12 12 2 -0.0002112
        18 12 0 4.4774e-06    18 16 0 0.00038163    18 16 1 -0.0011733    18 16 2 0.00084032
        18 17 0 2.3727e-05    18 17 2 -3.0013e-05
    """),
)

#: Angle in rad by which the measured BRUSA map's frame is turned against its symmetry axis, and the
#: skew part in H (psi carries it times J i): the measurement's own, removed by the fit.
BRUSA_ANGLE_OFFSET = radians(1.227)
BRUSA_SKEW = 9.88e-6

#: Measurement of an 85 kW traction motor, BRUSA HSM1-6.17.12. Source:
#: github.com/ExcitingSystems/exciting-environments, MIT. Covered: i_d -250..0 A, i_q -250..250 A;
#: i_d > 0 is extrapolated. Fitted in the frame turned by `BRUSA_ANGLE_OFFSET`, which makes the map
#: symmetric in i_q, and less `BRUSA_SKEW`; so corrected it is reproduced to 0.69 % (vector 0.98 %).
#: The measurement has no harmonics: those here are invented.
BRUSA_HSM1 = HarmonicCoenergy(
    scale_current=187.5,
    magnet_current=100.0,
    leakage_d=0.00041467,
    leakage_q=0.00023979,
    terms=_assumed_harmonics(70.8e-3, 4)
    + _terms("""
        0 0 1 0.067831      0 0 2 -0.030451     0 1 0 0.077886      0 1 1 0.0093747
        0 2 0 -0.082508     0 2 1 0.056332      0 2 2 -0.026283     0 3 0 -0.010264
        0 3 1 0.030602      0 3 2 -0.014701     0 4 0 -0.025438     0 4 1 0.047206
        0 4 2 -0.027476     0 5 0 -0.017312     0 5 1 0.060572      0 5 2 -0.052089
        0 6 0 -0.0055826    0 6 1 0.0059854     0 7 0 -0.00015007   0 8 0 -0.00060189
    """),
)

#: FEM of a 400 V traction machine at magnets of 60 degC. Source:
#: github.com/sbalajieeess/pmsm-femm-to-tinyml, MIT. Covered: i_d -424..-14 A, i_q 14..424 A; the
#: rest is extrapolated. The source knows one rotor angle, so its psi contains the harmonics at that
#: angle and is not the mean: error 1.5 % (vector 2.1 %). The harmonics here are invented.
EV400V = HarmonicCoenergy(
    scale_current=168.0,
    magnet_current=210.0,
    leakage_d=0.00011154,
    leakage_q=3.0168e-05,
    terms=_assumed_harmonics(62.9e-3, 6)
    + _terms("""
        0 0 0 0.10629       0 0 1 -0.032087     0 0 2 -0.016644     0 1 0 0.061359
        0 2 0 -0.022852     0 2 1 0.017208      0 2 2 -0.024995     0 3 0 0.0041291
        0 3 1 -0.01251      0 3 2 0.0099784     0 4 0 -0.0052493    0 4 1 0.0069044
        0 4 2 -0.0022817    0 5 0 -0.00078484   0 5 1 0.0045897     0 5 2 -0.0043076
        0 6 0 -0.0024455    0 6 1 0.0026605     0 7 0 6.8529e-05    0 8 0 -0.00013309
    """),
)
