"""What does not fit in memory is refused before it is tried, with the figure."""

import pytest

from penode.data import gathered
from penode.data.gathered import free_memory, require_memory
from penode.errors import InputError


def test_more_than_is_free_is_refused_with_what_would_fit(monkeypatch):
    monkeypatch.setattr(gathered, "free_memory", lambda: 3_000_000_000)
    require_memory(200_000, 15_000)
    with pytest.raises(InputError, match=r"take about 30 GB .*where 3 GB are free.*= 200000 in"):
        require_memory(2_000_000, 15_000)


def test_nothing_is_refused_where_the_system_does_not_say(monkeypatch):
    monkeypatch.setattr(gathered, "free_memory", lambda: None)
    require_memory(10**12, 15_000)


def test_a_container_has_what_its_limit_leaves(monkeypatch, tmp_path):
    for name, text in (("_MEMINFO", "MemTotal: 9000 kB\nMemAvailable: 8000 kB\n"),
                       ("_LIMIT", "4000000\n"), ("_TAKEN", "1000000\n")):  # fmt: skip
        (tmp_path / name).write_text(text)
        monkeypatch.setattr(gathered, name, tmp_path / name)
    assert free_memory() == 3_000_000
    (tmp_path / "_LIMIT").write_text("max\n")
    assert free_memory() == 8_192_000
    (tmp_path / "_MEMINFO").unlink()
    assert free_memory() > 8_192_000
