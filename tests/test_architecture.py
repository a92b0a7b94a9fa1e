"""ARCHITECTURE.md names files and folders that exist; budgets that ruff does not check."""

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PACKAGE = ROOT / "src" / "penode"
WORDS = re.findall(r"`([^`\s]+)`", (ROOT / "ARCHITECTURE.md").read_text())
#: Lines of a module.
LONGEST = 500
PATHS = sorted({word for word in WORDS if word.endswith(("/", ".py", ".toml"))})


@pytest.mark.parametrize("path", PATHS)
def test_every_path_named_exists(path):
    """A path is relative to the package or the repository; a bare name may lie in any folder."""
    inside_the_package = any(PACKAGE.rglob(path)) if "/" not in path else (PACKAGE / path).exists()
    assert inside_the_package or (ROOT / path).exists()


def test_the_table_of_changes_stays_short():
    rows = (ROOT / "ARCHITECTURE.md").read_text().split("| to change | open |\n|---|---|\n")[1]
    assert len(rows.split("\n\n")[0].splitlines()) <= 15


def test_modules_have_at_most_500_lines():
    lengths = {path: len(path.read_text().splitlines()) for path in PACKAGE.rglob("*.py")}
    assert not {str(path): n for path, n in lengths.items() if n > LONGEST}
