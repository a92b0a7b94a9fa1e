"""The commands as they are typed: arguments, options and pages of help; nothing here computes.

Only what a page of help needs is imported, so that it is there at once. What a command does stands
in the module of its name, as a function of the same parameters.
"""

from pathlib import Path
from typing import Annotated

import typer

#: What can be chosen, in the order of the registries, which the tests hold them against.
_FLUX_MAPS = ("coenergy", "convex", "mlp", "polynomial", "spline")
_TERMS = (
    "resistance",
    "temperature_resistance",
    "magnet_temperature",
    "dead_time",
    "phase_dead_time",
    "mean_dead_time",
)
_HOLDS = ("dq", "stationary")
_PURPOSES = ("parameters", "simulation", "one_step")
_FORMATS = ("csv", "npz", "mat", "m", "motorcad", "xlsx", "syre", "c", "c_fixed", "onnx")
_SIMULATIONS = ("paper_simulation", "paper_testbench", "well_designed")
_BY_DATA = "decided from the data"
Recordings = Annotated[
    list[Path],
    typer.Argument(help="Recordings: csv, xlsx, parquet, mat, mf4, tdms; with gaps, by stretches."),
]
SavedFit = Annotated[Path, typer.Argument(help="Folder that identify or demo wrote.")]
OutFolder = Annotated[Path, typer.Option(help="Folder for the results; made if absent.")]
Json = Annotated[bool, typer.Option("--json", help="One JSON document instead.")]
Config = Annotated[
    Path | None,
    typer.Option(help="Study file: columns, units, options. penode init writes one."),
]
Configs = Annotated[
    list[Path] | None,
    typer.Option(
        "--config",
        help="Study file: columns, units, options. penode init writes one. Again for recordings "
        "with other columns: each is read by the first that fits it; all else is the first's.",
    ),
]
FluxMapOption = Annotated[
    str | None,
    typer.Option(
        help=f"One of {', '.join(_FLUX_MAPS)}.",
        show_default="coenergy",
        autocompletion=lambda: list(_FLUX_MAPS),
    ),
]
Inverter = Annotated[
    bool | None,
    typer.Option(
        help="Dead time and on-state drops of the inverter, in the model or not; needs theta_el.",
        show_default=_BY_DATA,
    ),
]
Terms = Annotated[
    str | None,
    typer.Option(
        help=f"Terms of the voltage equation beside R and rotation, or in place of R: "
        f"{', '.join(_TERMS)}. With commas.",
        show_default="resistance; dead_time is decided from the data",
        autocompletion=lambda: list(_TERMS),
    ),
]
AngleOrders = Annotated[
    str | None,
    typer.Option(
        help="Harmonics of the angle in the map, such as 6,12, or none; they need theta_el.",
        show_default=_BY_DATA,
    ),
]
HoldOption = Annotated[
    str | None,
    typer.Option(
        help=f"Frame in which the voltage is held: {' or '.join(_HOLDS)}.",
        show_default=_BY_DATA,
        autocompletion=lambda: list(_HOLDS),
    ),
]
TrustClasses = Annotated[
    bool,
    typer.Option(
        "--trust-classes",
        help="Import the modules of the fit's own classes, which runs them.",
    ),
]


def demo(out: OutFolder = Path("penode-demo")) -> None:
    """Show the whole story on the built-in machine: record, identify, compare with the truth.

    Example: penode demo --out demo
    """


def init(
    recording: Annotated[
        Path, typer.Argument(metavar="FILE", help="Recording: csv, xlsx, parquet, mat, mf4, tdms.")
    ],
    out: Annotated[Path, typer.Option(help="Study file to write; never overwritten.")] = Path(
        "study.toml"
    ),
    standstill: Annotated[
        bool, typer.Option("--standstill", help="The rotor stood still: no column has a speed.")
    ] = False,
) -> None:
    """Write a study file with the best guesses from a recording, each with its reason.

    Then: penode identify FILE --config study.toml --out result

    Example: penode init bench.mf4 --out bench.toml
    """


def check(
    runs: Recordings,
    config: Configs = None,
    picture: Annotated[Path | None, typer.Option(help="PNG of what is covered.")] = None,
    pole_pairs: Annotated[int | None, typer.Option(help="Of the machine.", min=1)] = None,
    as_json: Json = False,
) -> None:
    """Check what recordings determine and what they cannot, before any training: a few seconds.

    Quality of the channels, their conventions tested against physics, what currents and speeds
    cover, and how far the resistance can be distinguished from the map. Of a table of operating
    points, which has no column t: what they cover, how sure R is, and what more would bring.

    Exit status: 0 all is well, 1 a convention is broken or the data cannot answer, 2 bad input.

    Example: penode check run.csv --picture cover.png
    """


def identify(  # noqa: PLR0913 (an argument an option)
    runs: Recordings,
    out: OutFolder,
    validate: Annotated[
        list[Path] | None, typer.Option(help="Recording to predict, not to train on. Repeatable.")
    ] = None,
    points: Annotated[
        Path | None,
        typer.Option(help="Table of operating points of the same bench, which narrows R and map."),
    ] = None,
    points_config: Annotated[
        Path | None,
        typer.Option(
            help="Study file of that table: columns and units.", show_default="that of --config"
        ),
    ] = None,
    config: Configs = None,
    horizon: Annotated[
        str | None, typer.Option(help="auto, or the number of steps.", show_default="auto")
    ] = None,
    flux_map: FluxMapOption = None,
    inverter: Inverter = None,
    terms: Terms = None,
    angle_orders: AngleOrders = None,
    hold: HoldOption = None,
    pole_pairs: Annotated[
        int | None,
        typer.Option(help="Of the machine; a speed or angle of the shaft needs them.", min=1),
    ] = None,
    purpose: Annotated[
        str | None,
        typer.Option(
            help=f"What the horizon is chosen for: {', '.join(_PURPOSES)}.",
            show_default="parameters",
            autocompletion=lambda: list(_PURPOSES),
        ),
    ] = None,
    seed: Annotated[
        int | None,
        typer.Option(
            help="Seed of window placement, and of the draw of a map other than coenergy.",
            show_default="0",
            min=0,
            max=2**63 - 1,
        ),
    ] = None,
    train_anyway: Annotated[
        bool,
        typer.Option("--train-anyway", help="Train though a convention of the channels is broken."),
    ] = False,
    resume: Annotated[
        bool, typer.Option("--resume", help="Go on with the fit that was stopped in --out.")
    ] = False,
    overwrite: Annotated[
        bool, typer.Option("--overwrite", help="Replace the result that is in --out.")
    ] = False,
    show: Annotated[
        bool, typer.Option("--open", help="Open the report in the browser at the end.")
    ] = False,
    as_json: Annotated[bool, typer.Option("--json", help="Print result.json instead.")] = False,
) -> None:
    """Identify resistance and flux-linkage map from recordings of a drive.

    Columns: t (s), u_d and u_q (V), i_d and i_q (A), omega_el (rad/s, electrical), optionally
    theta_el (rad); or u_a .. u_c, i_a .. i_c and theta_el. Currents and voltages are peak values.
    A file without t is a table of operating points: torque (Nm) of the shaft counts there too.
    Anything else is mapped by a study file, given with --config; options override its entries.

    Ctrl-C stops with the best so far, written as a whole result; the same command with --resume
    added goes on after the last finished horizon. Ctrl-C a second time leaves at once.

    Exit status: 0 done, 1 the data cannot answer, 2 unusable input, 70 a failure of penode, 130
    stopped.

    Example: penode identify run.csv --validate other.csv --out result
    """


def report(
    folder: Annotated[
        Path, typer.Argument(help="Folder that identify, demo, sweep or Fit.save wrote.")
    ],
    against: Annotated[
        Path | None,
        typer.Option(help="A second map to draw beside: a CSV such as flux_map.csv, or a folder."),
    ] = None,
    pdf: Annotated[
        bool, typer.Option("--pdf", help="Print it to report.pdf too, by Chromium or Chrome.")
    ] = False,
    trust: TrustClasses = False,
) -> None:
    """Write report.html from a saved fit, of a machine or of any other model, or from a sweep.

    A model of your own is imported from its module with --trust-classes alone, as this runs the
    module: give the command in that module's folder, or name the folder in PYTHONPATH.

    Example: penode report result

    Example: penode report result --against fem.csv

    Example: penode report fleet

    Example: penode report motor --trust-classes
    """


def export(
    folder: SavedFit,
    to: Annotated[
        str,
        typer.Option(help=f"One of {', '.join(_FORMATS)}.", autocompletion=lambda: list(_FORMATS)),
    ],
    out: Annotated[Path, typer.Option(help="File to write; its suffix is that of the format.")],
    points: Annotated[
        int | None, typer.Option(help="Points a side of the grid; 41, but 256 for syre.")
    ] = None,
    pole_pairs: Annotated[int | None, typer.Option(help="Of the machine, for the torque.")] = None,
    trust: TrustClasses = False,
) -> None:
    """Write the flux map of a saved fit for a controller or another program.

    csv: flux_map.csv; npz: motulator; syre: SyR-e's fdfq_idiq; xlsx: a workbook;
    mat, m: tables for Simulink and Simscape, as a file and as a script, with i(psi) and MTPA;
    motorcad: what reads a saturation map of Motor-CAD; over the rotor's angle too, as is mat;
    c, c_fixed: a C99 header with look-ups of psi, i(psi), torque and MTPA, in float or 16 bits;
    onnx: the map itself, as a graph.

    Example: penode export result --to c --out machine.h
    """


def loci(  # noqa: PLR0913 (an argument an option)
    folder: SavedFit,
    i_max: Annotated[
        float | None,
        typer.Option(
            help="Current limit in A, peak value of a phase.",
            show_default="up to where recordings back MTPA",
        ),
    ] = None,
    out: Annotated[Path | None, typer.Option(help="PNG to write.")] = None,
    u_max: Annotated[
        float | None,
        typer.Option(
            help="Voltage limit in V, peak of a phase: u_dc / sqrt(3).",
            show_default="that of the recorded u_dc",
        ),
    ] = None,
    pole_pairs: Annotated[int | None, typer.Option(help="Of the machine.")] = None,
    csv: Annotated[Path | None, typer.Option(help="CSV of the loci to write as well.")] = None,
    table: Annotated[
        Path | None, typer.Option(help="CSV of i_d, i_q over torque and speed to write as well.")
    ] = None,
    torque: Annotated[
        str | None,
        typer.Option(
            help="Torques of the table in Nm, lowest:highest:points.",
            show_default="21 up to the most",
        ),
    ] = None,
    speed: Annotated[
        str | None,
        typer.Option(
            help="Speeds of the table in rpm, lowest:highest:points.",
            show_default="21 up to twice the base speed",
        ),
    ] = None,
    as_json: Json = False,
    trust: TrustClasses = False,
) -> None:
    """Compute what a controller needs: MTPA, MTPV, torque over speed, and currents over both.

    Example: penode loci result --pole-pairs 5

    Example: penode loci result --i-max 240 --u-max 230 --pole-pairs 5 --out loci.png

    Example: penode loci result --u-max 230 --table points.csv --torque 0:200:21 --speed 0:9000:31
    """


def compare(
    first: SavedFit,
    second: Annotated[Path, typer.Argument(help="Another one, or a map such as flux_map.csv.")],
    out: Annotated[Path | None, typer.Option(help="PNG to write.", show_default="none")] = None,
    as_json: Json = False,
    trust: TrustClasses = False,
) -> None:
    """Compare a saved fit with another one, or with a map in a CSV file.

    Differences are the second less the first, where both are supported.

    Example: penode compare cold warm --out difference.png
    """


def _simulations() -> list[str]:
    """Return the names of the shipped simulations and the TOML files at hand."""
    return [*_SIMULATIONS, *sorted(str(path) for path in Path().glob("*.toml"))]


def simulate(
    config: Annotated[
        str,
        typer.Argument(
            help="TOML file, or the name of a shipped one.", autocompletion=_simulations
        ),
    ],
    out: Annotated[Path, typer.Option(help="Recording to write, .csv or .parquet.")],
    picture: Annotated[
        Path | None, typer.Option(help="PNG to write as well: trajectory and spectra.")
    ] = None,
    over_time: Annotated[
        Path | None, typer.Option(help="PNG to write as well: currents, voltages, torque.")
    ] = None,
    against: Annotated[
        Path | None,
        typer.Option(help="Recording on the same reference, to hold the simulation against."),
    ] = None,
    study: Annotated[
        Path | None, typer.Option(help="Study file that maps the columns of --against.")
    ] = None,
) -> None:
    """Record a run on the simulated bench, with the truth written beside it.

    Shipped: paper_simulation, paper_testbench, well_designed. In a TOML file of your own the
    machine may be a built-in one, a flux map in a file, or what penode identify wrote.

    Example: penode simulate paper_testbench --out run.csv

    Example: penode simulate drive.toml --out drive.csv --over-time drive.png --against run.csv
    """


def sweep(  # noqa: PLR0913 (an argument an option)
    out: OutFolder,
    runs: Annotated[
        list[Path] | None,
        typer.Argument(help="Recordings, each by itself, in place of the study file's."),
    ] = None,
    horizons: Annotated[
        str | None,
        typer.Option(
            help="Steps, with commas between them, or auto.", show_default="the study's, or auto"
        ),
    ] = None,
    seeds: Annotated[
        int | None, typer.Option(help="Seeds at each horizon, from 0.", show_default="one")
    ] = None,
    config: Config = None,
    flux_map: FluxMapOption = None,
    inverter: Inverter = None,
    terms: Terms = None,
    angle_orders: AngleOrders = None,
    hold: HoldOption = None,
    jobs: Annotated[
        int | None, typer.Option(help="Processes side by side.", show_default="one a core")
    ] = None,
    dask: Annotated[
        str | None, typer.Option(help="Scheduler of a Dask cluster to work on, host:port.")
    ] = None,
) -> None:
    """Identify many recordings, each by itself, at horizons, from seeds, in variants.

    What is swept stands in the table sweep of the study file, or in options. Writes table.jsonl,
    a line a task as it ends, fits/KEY for penode report and penode export, and at the end
    table.parquet and report.html.

    Ctrl-C stops; the same command goes on. What is finished is not done again as long as data,
    settings and penode are the same; to change the study file adds to the table.

    Example: penode sweep run.csv --horizons 1,10,100 --seeds 3 --out sweep

    Example: penode sweep --config fleet.toml --out fleet --jobs 8
    """


def reproduce(
    study: Annotated[str, typer.Argument(help="all, or the name of one study.")],
    out: OutFolder,
    quick: Annotated[
        bool,
        typer.Option(
            "--quick", help="A small part of everything, in a few minutes, to see that it runs."
        ),
    ] = False,
) -> None:
    """Rebuild the paper's experiments on the simulated bench, ours beside them.

    Studies: resistance_vs_horizon, flux_error_vs_horizon, generalisation_vs_horizon,
    testbench_resistance, well_designed, subdomain, solver_dependence, table.

    Every training is kept as it ends. After Ctrl-C the same command goes on.

    Example: penode reproduce all --out studies --quick
    """
