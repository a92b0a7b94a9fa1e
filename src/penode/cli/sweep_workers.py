"""Where the tasks of a sweep are done: processes of this machine, or a Dask cluster."""

import multiprocessing
import os
import signal
import threading
from collections import Counter
from collections.abc import Callable, Iterator
from concurrent.futures import FIRST_COMPLETED, Executor, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import ExitStack, contextmanager
from functools import cache, partial
from importlib import import_module
from multiprocessing.connection import wait as wait_for
from typing import TYPE_CHECKING, Any

from penode.cli.compilation_cache import use_compilation_cache
from penode.errors import InputError
from penode.pmsm.sweep.task import Outcome, Task, failed, run

if TYPE_CHECKING:
    from penode.pmsm.sweep.run import Workers

#: Seconds until Ctrl-C is noticed.
_NOTICE = 0.2
#: How often a task that ends its worker is given to another one.
_TRIES = 3
#: Tasks that a cluster is given for each of its threads: the next is there when one has ended.
_AHEAD = 2


@contextmanager
def processes(count: int) -> Iterator["Workers"]:
    """Give workers that are processes of this machine, of one thread each; refuse less than one.

    A process that is lost is replaced, and its task is done again; Ctrl-C ends them all.
    """
    if count < 1:
        raise InputError(f"--jobs must be >= 1, got {count}.")
    spawned = multiprocessing.get_context("spawn")  # forked, JAX would wait for itself
    with ExitStack() as open_:

        def process() -> Executor:
            # One an executor: a process that is lost takes no other's task with it.
            return open_.enter_context(ProcessPoolExecutor(1, spawned, _begin))

        try:
            yield partial(_outcomes, [process] * count, BrokenProcessPool)
        except BaseException:
            for child in multiprocessing.active_children():
                child.kill()
            raise


@contextmanager
def cluster(address: str) -> Iterator["Workers"]:
    """Give the workers of a Dask cluster, which see the recordings at the same paths.

    ``address`` is its scheduler's; refuses one that does not answer, and a missing distributed.
    """
    try:
        distributed: Any = import_module("distributed")
    except ImportError as error:
        raise InputError(
            "--dask needs the package distributed; install penode[cluster], or use --jobs."
        ) from error
    try:
        client = distributed.Client(address, timeout=10)
    except (OSError, ValueError) as error:
        raise InputError(f"--dask {address}: no scheduler answers there ({error}).") from error
    with client:
        executor = client.get_executor(pure=False)
        threads = sum(client.nthreads().values())
        places = [lambda: executor] * max(_AHEAD * threads, 1)
        try:
            yield partial(_outcomes, places, distributed.KilledWorker)
        except BaseException:
            executor.shutdown(wait=False)
            raise


def _outcomes(
    places: list[Callable[[], Executor]], lost: type[Exception], tasks: Iterator[Task]
) -> Iterator[tuple[Task, Outcome]]:
    """Give each place a task as it is free; a task that ended its worker is done again.

    A place is called for an executor, anew where that one is lost.
    """
    idle, again, tries = [(new, new()) for new in places], list[Task](), Counter[str]()
    busy: dict[Future[Outcome], tuple[Callable[[], Executor], Executor, Task]] = {}
    while True:
        while idle and (task := again.pop() if again else next(tasks, None)):
            renew, executor = idle.pop()
            with _ctrl_c_held():
                busy[executor.submit(_done, task)] = renew, executor, task
        if not busy:
            return
        # A wait without end would not notice Ctrl-C before the next one is done.
        ended, _ = wait(busy, timeout=_NOTICE, return_when=FIRST_COMPLETED)
        for future in ended:
            renew, executor, task = busy.pop(future)
            try:
                outcome = future.result()
            except lost:
                executor = renew()
                tries[task.key] += 1
                if tries[task.key] < _TRIES:
                    again.append(task)
                    idle.append((renew, executor))
                    continue
                outcome = failed(f"It ended its worker {_TRIES} times; memory may be too small.")
            idle.append((renew, executor))
            yield task, outcome


@contextmanager
def _ctrl_c_held() -> Iterator[None]:
    """Hold Ctrl-C back while a process may start: it does not know it, in its imports neither."""
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


_prepare = cache(use_compilation_cache)


def _done(task: Task) -> Outcome:
    _prepare()
    return run(task)


def _begin() -> None:
    """Prepare a process: Ctrl-C is the parent's to handle, and a dead parent ends it."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    os.environ["NPROC"] = "1"  # read by XLA: as many processes as cores, and not more threads
    threading.Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    parent = multiprocessing.parent_process()
    if parent is not None:
        wait_for([parent.sentinel])
        os._exit(1)
