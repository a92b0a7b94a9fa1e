"""ARCHITECTURE.md names files and folders that exist."""

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PACKAGE = ROOT / "src" / "penode"
WORDS = re.findall(r"`([^`\s]+)`", (ROOT / "ARCHITECTURE.md").read_text())
PATHS = sorted({word for word in WORDS if word.endswith(("/", ".py", ".toml"))})


@pytest.mark.parametrize("path", PATHS)
def test_every_path_named_exists(path):
    """A path is relative to the package or the repository; a bare name may lie in any folder."""
    inside_the_package = any(PACKAGE.rglob(path)) if "/" not in path else (PACKAGE / path).exists()
    assert inside_the_package or (ROOT / path).exists()
