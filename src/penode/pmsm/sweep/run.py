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
    waiting: defaultdict[str, list[Mapping[str, Any]]] = defaultdict(list)
    ready: deque[Row] = deque()
    with open_table(folder) as table:
        for task, outcome in workers(_todo(campaign, table, waiting, ready)):
            while ready:
                yield ready.popleft()
            for labels in waiting.pop(task.key):
                yield table.keep(task.key, labels, outcome)
        yield from ready
    write_parquet(campaign.labels(), folder)


def _todo(
    campaign: Campaign,
    table: Table,
    waiting: defaultdict[str, list[Mapping[str, Any]]],
    ready: deque[Row],
) -> Iterator[Task]:
    """Yield the tasks that have to be done, each once, with the rows that wait for them.

    Rows that are there without a task are put among those that are ready.
    """
    for planned in campaign.planned():
        task = planned.task
        if task is None:
            ready.append(table.keep("", planned.labels, failed(planned.error)))
        elif table.done(task.key):
            ready.append(table.called(task.key, planned.labels))
        else:
            waiting[task.key].append(planned.labels)
            if len(waiting[task.key]) == 1:
                yield task
