"""PMSM-ID: 144 logs of drives of three simulators, a hidden truth, a scorer and ten methods.

A method gets a log and its entry of ``tasks.json``: the number of pole pairs, the name plate, and
the currents at which its flux map is asked for. It never sees ``truth.json``. What it answers is a
line of JSON a log, see `score`; how to enter one is said in ``docs/validation/pmsm-id.md``.

Two Pythons take part. `tasks` and `simulated` run in both and know nothing of penode.
"""
