"""The folder of a result: one process writes there at a time, and its files are replaced as one."""

import json
import os
import shutil
import sys
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path

from penode.data.load import READERS
from penode.errors import InputError
from penode.fit.archive import content_of, name_file, sha256

RESULT, REPORT = "result.json", "report.html"
#: Inside the folder while something is written: held by the process that writes, the files that it
#: has made so far, and files that are whole and on their way to their places.
_LOCK, _STAGED, _COMMITTED = ".lock", ".staged", ".committed"


@contextmanager
def claimed(folder: Path) -> Iterator[None]:
    """Keep other processes out of a folder, made if absent, while this one writes there.

    What a process that died had written whole is brought to its place, and the rest of it is
    removed. The claim of a dead process is none. Where the system has no locks, as on Windows,
    nothing is kept out. The folder is removed again if nothing came into it.
    """
    made = [path for path in (folder, *folder.parents) if not path.exists()]
    folder.mkdir(parents=True, exist_ok=True)
    try:
        with _locked(folder):
            _move_committed(folder)
            shutil.rmtree(folder / _STAGED, ignore_errors=True)
            yield
    finally:
        for path in made:
            with suppress(OSError):
                path.rmdir()


def replace_together(folder: Path, files: Mapping[str, bytes]) -> None:
    """Replace files of a folder that the caller claimed as one, as far as a file system can.

    All are written beside the old ones, then one step commits them, then they are moved to their
    places. What interrupts this before the step leaves the old files as they were; after it, the
    next claim or `Fit.load` moves the rest. The report of an earlier result is removed.
    """
    staged = folder / _STAGED
    try:
        for name, content in files.items():
            path = staged / name
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_bytes(content)
        staged.rename(folder / _COMMITTED)
    except BaseException as error:
        name_file(error, folder / name)
        shutil.rmtree(staged, ignore_errors=True)
        raise
    try:
        _move_committed(folder)
    except KeyboardInterrupt:
        _move_committed(folder)
        raise


def digests(files: Mapping[str, bytes]) -> dict[str, str]:
    """Return the SHA-256 of contents by name."""
    return {name: sha256(content) for name, content in files.items()}


def require_one_result(folder: Path) -> None:
    """Refuse a file, and a folder with files of several results.

    Files that a process which died had committed are moved to their places first. Each file must be
    the one that ``result.json`` was written with; without that one, or one of an earlier version in
    it, nothing is examined.
    """
    if folder.is_file():
        raise _not_a_folder(folder)
    if (folder / _COMMITTED).is_dir():
        with suppress(InputError, OSError), claimed(folder):
            pass
    try:
        result = json.loads(content_of(folder / RESULT))
        written = dict(result.get("files", {}))
    except (FileNotFoundError, NotADirectoryError):
        return
    except InputError:
        raise
    except (ValueError, TypeError, AttributeError, RecursionError) as error:
        raise InputError(
            f"{folder / RESULT}: not as it was written ({type(error).__name__}); put back the one "
            "that was, or run the identification again."
        ) from error
    for name, digest in written.items():
        path = folder / name
        if path.is_file() and sha256(path.read_bytes()) != digest:
            raise InputError(
                f"{path}: not the file that {RESULT} beside it was written with; put back the one "
                "that was, or run the identification again."
            )


def _not_a_folder(file: Path) -> InputError:
    """Return the refusal of a file, which is most often a recording or a part of a result."""
    folder = file.parent.parent if file.parent.name == "fit" else file.parent
    if (folder / RESULT).is_file():
        repair = f"give the folder, {folder}."
    elif not {suffix.lower() for suffix in file.suffixes} & set(READERS):
        repair = "give the one that `penode identify --out` wrote."
    else:
        out = file.name.split(".")[0]
        repair = (
            f"if it is a recording, identify it first: `penode identify {file} --out {out}`, with "
            f"--config where it has a study file, then give {out}."
        )
    return InputError(f"{file}: this is a file where the folder of a result was wanted; {repair}")


def _move_committed(folder: Path) -> None:
    committed = folder / _COMMITTED
    if (committed / RESULT).is_file():  # the report there is of an earlier result
        (folder / REPORT).unlink(missing_ok=True)
    for path in sorted(committed.rglob("*")):
        if path.is_file():
            target = folder / path.relative_to(committed)
            target.parent.mkdir(exist_ok=True)
            path.replace(target)
    shutil.rmtree(committed, ignore_errors=True)


@contextmanager
def _locked(folder: Path) -> Iterator[None]:
    """Hold the folder's lock, which the system releases when the process ends in whatever way."""
    path = folder / _LOCK
    while True:
        handle = os.open(path, os.O_RDWR | os.O_CREAT, 0o666)
        try:
            _lock(handle, folder)
            with suppress(OSError):
                # Another process may have removed the file after this one had opened it.
                if os.path.samestat(os.fstat(handle), path.stat()):
                    break
        except BaseException:
            os.close(handle)
            raise
        os.close(handle)
    try:
        yield
    finally:
        if sys.platform != "win32":
            path.unlink(missing_ok=True)
        os.close(handle)


if sys.platform == "win32":

    def _lock(handle: int, folder: Path) -> None: ...

else:
    import fcntl

    def _lock(handle: int, folder: Path) -> None:
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError as error:
            raise InputError(
                f"{folder}: another process of penode writes there; wait until it has ended, or "
                "give another folder."
            ) from error
        except OSError:
            return  # a file system without locks
