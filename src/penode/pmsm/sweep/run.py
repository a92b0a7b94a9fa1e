"""Runs a campaign: what is done already stays, the rest goes to workers, rows come as they end."""

from collections import defaultdict, deque
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any, TypeAlias

from penode.pmsm.sweep.campaign import Campaign
from penode.pmsm.sweep.table import Table, open_table, write_parquet
from penode.pmsm.sweep.task import Outcome, Task, failed

#: Workers: tasks, drawn as there is room, to pairs of a task and what came of it, in any order.
Workers: TypeAlias = Callable[[Iterator[Task]], Iterator[tuple[Task, Outcome]]]

Row: TypeAlias = dict[str, Any]


def sweep(campaign: Campaign, folder: Path, workers: Workers) -> Iterator[Row]:
    """Do what of a campaign is not done, and give each row of its table as it is there.

    The folder, claimed by the caller, gets ``table.jsonl``, a line a row as tasks end, ``fits/KEY``
    with what `penode.Fit.load` reads, and at the end ``table.parquet``: the campaign's rows in its
    order.
    """
    with open_table(folder) as table:
        run = _Run(campaign, table)
        for task, outcome in workers(run.todo()):
            yield from run.ready()
            yield from run.ended(task, outcome)
        yield from run.ready()
    write_parquet(campaign.labels(), folder)


class _Run:
    """Which rows of a campaign wait for a task, and which are there without one."""

    def __init__(self, campaign: Campaign, table: Table):
        self._campaign, self._table = campaign, table
        self._waiting: defaultdict[str, list[Mapping[str, Any]]] = defaultdict(list)
        self._ready: deque[Row] = deque()

    def todo(self) -> Iterator[Task]:
        """Yield the tasks that have to be done, each once."""
        for planned in self._campaign.planned():
            task = planned.task
            if task is None:
                self._ready.append(self._table.keep("", planned.labels, failed(planned.error)))
            elif self._table.done(task.key):
                self._ready.append(self._table.called(task.key, planned.labels))
            else:
                same = self._waiting[task.key]
                same.append(planned.labels)
                if len(same) == 1:
                    yield task

    def ended(self, task: Task, outcome: Outcome) -> Iterator[Row]:
        """Keep what came of a task, in each row that waits for it."""
        for labels in self._waiting.pop(task.key):
            yield self._table.keep(task.key, labels, outcome)

    def ready(self) -> Iterator[Row]:
        """Yield rows that were there without a task."""
        while self._ready:
            yield self._ready.popleft()
