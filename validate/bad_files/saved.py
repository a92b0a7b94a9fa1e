"""Saved fits, results and checkpoints that were damaged, mixed or made to do harm."""

import io
import json
import shutil
import zipfile
from collections.abc import Callable
from functools import cache
from pathlib import Path
from tempfile import mkdtemp
from typing import Any

import numpy as np

from penode.fit.archive import archive, read_archive, sha256
from penode.horizon.checkpoint import Checkpoint
from penode.pmsm.result_files import write
from penode.pmsm.study import identify
from penode.pmsm.study_file import load_study
from validate.bad_files.good import changed, csv

#: Settings of the saved fit.
ASKED = ("--horizon", "3", "--no-inverter", "--angle-orders", "none")
_CHECKPOINT = "fit/checkpoint.json"
_RESUME = ("identify", "run.csv", "--out", "fitted", *ASKED, "--resume")
_REPORT = ("report", "fitted")
_LOCI = ("loci", "fitted", "--pole-pairs", "5")
_EXPORT = ("export", "fitted", "--to", "c", "--out", "map.h")

Damage = Callable[[Path], object]


@cache
def saved() -> Path:
    """Return a folder with a recording, and a folder ``fitted`` with its fit and checkpoint."""
    folder = Path(mkdtemp(prefix="penode-saved-"))
    (folder / "run.csv").write_text(csv())
    asked = load_study(None, {"horizon": 3, "inverter": False, "angle_orders": ()})
    out = folder / "fitted"
    (out / "fit").mkdir(parents=True)
    run = asked.load(folder / "run.csv")
    write(identify([run], study=asked.study, checkpoint=Checkpoint(out / _CHECKPOINT)), out)
    return folder


def _text(name: str, change: Callable[[str], str]) -> Damage:
    """Return what changes the text of a file."""

    def damage(folder: Path) -> None:
        path = folder / "fitted" / name
        path.write_text(change(path.read_text()))

    return damage


def _removed(name: str) -> Damage:
    return lambda folder: (folder / "fitted" / name).unlink()


def _rewritten(change: Callable[[dict[str, Any], dict[str, Any]], object]) -> Damage:
    """Return what changes document and arrays of the fit, and makes digests to match."""

    def damage(folder: Path) -> None:
        (folder / "fitted" / "result.json").unlink()
        document, arrays = read_archive(folder / "fitted" / "fit")
        change(document, arrays)
        for name, content in archive(document, arrays).items():
            (folder / "fitted" / "fit" / name).write_bytes(content)

    return damage


def _arrays(make: Callable[[], bytes]) -> Damage:
    """Return what puts another NPZ beside the document, with digests to match."""

    def damage(folder: Path) -> None:
        (folder / "fitted" / "result.json").unlink()
        document, _ = read_archive(folder / "fitted" / "fit")
        files = archive(document, {})
        whole = json.loads(files["fit.json"])
        content = make()
        whole.pop("sha256")
        whole["arrays_sha256"] = sha256(content)
        (folder / "fitted/fit/fit.npz").write_bytes(content)
        (folder / "fitted/fit/fit.json").write_text(json.dumps(whole))

    return damage


def _npz_bomb() -> bytes:
    """Return 3 GB of zeros in 3 MB, as an array."""
    head = io.BytesIO()
    np.lib.format.write_array_header_1_0(
        head, {"descr": "<f8", "fortran_order": False, "shape": (400_000_000,)}
    )
    written = io.BytesIO()
    with (
        zipfile.ZipFile(written, "w", zipfile.ZIP_DEFLATED, compresslevel=1) as packed,
        packed.open("excited.npy", "w", force_zip64=True) as file,
    ):
        file.write(head.getvalue())
        for _ in range(3200):
            file.write(bytes(1_000_000))
    return written.getvalue()


def _pickled() -> bytes:
    written = io.BytesIO()
    np.savez(written, excited=np.array([{}, {}], dtype=object))
    return written.getvalue()


def _class(name: str) -> Damage:
    return _rewritten(lambda document, _: document["model"].update({"class": name}))


def _array(name: str, value: Any) -> Damage:
    return _rewritten(lambda _, arrays: arrays.update({name: value}))


def _first_of_model(value: Callable[[np.ndarray], np.ndarray]) -> Damage:
    def change(_: dict[str, Any], arrays: dict[str, Any]) -> None:
        name = next(name for name in arrays if name.startswith("model."))
        arrays[name] = value(arrays[name])

    return _rewritten(change)


def _nothing(folder: Path) -> None: ...


def _emptied(folder: Path) -> None:
    shutil.rmtree(folder / "fitted")
    (folder / "fitted").mkdir()


def _mixed(folder: Path) -> None:
    """Put another fit beside the result, as if it had been copied by hand."""
    document, arrays = read_archive(folder / "fitted/fit")
    document["warnings"] = ["another"]
    for name, content in archive(document, arrays).items():
        (folder / "fitted/fit" / name).write_bytes(content)


def _other_recording(folder: Path) -> None:
    (folder / "run.csv").write_text(csv(changed(i_d=1.001 * changed()["i_d"])))


def _as_folder(folder: Path) -> None:
    (folder / "fitted" / _CHECKPOINT).unlink()
    (folder / "fitted" / _CHECKPOINT).mkdir()


#: What happens to the folder of a good fit, and the arguments of the command that meets it.
SAVED: dict[str, tuple[Damage, tuple[str, ...]]] = {
    "report: no such folder": (_nothing, ("report", "gone")),
    "report: an empty folder": (_emptied, _REPORT),
    "report: a file": (_nothing, ("report", "run.csv")),
    "fit: no document": (_removed("fit/fit.json"), _REPORT),
    "fit: no arrays": (_removed("fit/fit.npz"), _REPORT),
    "fit: document cut": (_text("fit/fit.json", lambda text: text[:5000]), _REPORT),
    "fit: a digit changed": (_text("fit/fit.json", lambda t: t.replace("1", "2", 1)), _EXPORT),
    "fit: of another result": (_mixed, _REPORT),
    "fit: result.json cut": (_text("result.json", lambda text: text[:100]), _REPORT),
    "fit: result.json a list": (_text("result.json", lambda _: "[1, 2]"), _REPORT),
    "fit: result.json 10^5 deep": (_text("result.json", lambda _: "[" * 100_000), _REPORT),
    "fit: an endless device": (
        lambda folder: [
            _removed("fit/fit.json")(folder),
            (folder / "fitted/fit/fit.json").symlink_to("/dev/zero"),
        ],
        _REPORT,
    ),
    "fit: of a later schema": (
        _rewritten(lambda document, _: document.update(schema="penode-fit/99")),
        _REPORT,
    ),
    "fit: a class of another module": (_class("antigravity:Model"), _REPORT),
    "fit: a function for a class": (_class("penode.identify:identify"), _REPORT),
    "fit: a class that is not there": (_class("penode.pmsm:Nothing"), _REPORT),
    "fit: no model": (_rewritten(lambda document, _: document.pop("model")), _REPORT),
    "fit: no parameters": (_rewritten(lambda document, _: document.pop("parameters")), _EXPORT),
    "fit: visited states that are none": (_array("excited", np.empty((0, 2))), _EXPORT),
    "fit: visited states not finite": (_array("excited", np.full((9, 2), np.nan)), _EXPORT),
    "fit: a model not finite": (_first_of_model(lambda values: values * np.nan), _EXPORT),
    "fit: a model of another shape": (_first_of_model(lambda values: np.ones((3, 3, 3))), _EXPORT),
    "fit: a model of words": (_first_of_model(lambda values: np.array(["a"])), _EXPORT),
    "fit: pickled objects": (_arrays(_pickled), _REPORT),
    "fit: arrays that are no ZIP": (_arrays(lambda: b"PK\x03\x04" + bytes(100)), _REPORT),
    "fit: 3 GB of zeros in 3 MB": (_arrays(_npz_bomb), _REPORT),
    "resume: checkpoint cut": (_text(_CHECKPOINT, lambda text: text[:1000]), _RESUME),
    "resume: checkpoint changed": (_text(_CHECKPOINT, lambda t: t.replace("0.", "1.", 1)), _RESUME),
    "resume: checkpoint not JSON": (_text(_CHECKPOINT, lambda _: "checkpoint"), _RESUME),
    "resume: checkpoint a folder": (_as_folder, _RESUME),
    "resume: another recording": (_other_recording, _RESUME),
    "resume: another horizon": (_nothing, (*_RESUME, "--horizon", "5")),
    "resume: another seed": (_nothing, (*_RESUME, "--seed", "5")),
    "resume: another purpose": (_nothing, (*_RESUME, "--purpose", "simulation")),
    "resume: another flux map": (_nothing, (*_RESUME, "--flux-map", "convex")),
    "export: format unknown": (_nothing, ("export", "fitted", "--to", "xls", "--out", "a.xls")),
    "export: suffix of another": (_nothing, ("export", "fitted", "--to", "c", "--out", "a.mat")),
    "export: in no folder": (_nothing, ("export", "fitted", "--to", "c", "--out", "run.csv/a.h")),
    "export: one point": (_nothing, (*_EXPORT, "--points", "1")),
    "export: a million points a side": (_nothing, (*_EXPORT, "--points", "1000000")),
    "export: no pole pairs": (_nothing, (*_EXPORT, "--pole-pairs", "0")),
    "loci: i_max negative": (_nothing, (*_LOCI, "--i-max", "-1", "--out", "a.png")),
    "loci: i_max = nan": (_nothing, (*_LOCI, "--i-max", "nan", "--out", "a.png")),
    "loci: a suffix unknown": (_nothing, ("loci", "fitted", "--i-max", "200", "--out", "a.gif")),
    "compare: with nothing": (_nothing, ("compare", "fitted", "gone", "--out", "a.png")),
    "compare: with no map": (_nothing, ("compare", "fitted", "run.csv", "--out", "a.png")),
}


def cases() -> dict[str, tuple[Damage, tuple[str, ...]]]:
    """Return what makes the files of each kind, and the arguments of penode."""

    def made(damage: Damage) -> Damage:
        def make(folder: Path) -> None:
            shutil.copytree(saved(), folder, dirs_exist_ok=True)
            damage(folder)

        return make

    return {kind: (made(damage), arguments) for kind, (damage, arguments) in SAVED.items()}
