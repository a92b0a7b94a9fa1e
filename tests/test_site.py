"""The site needs no network, and every page of it can be found."""

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
DOCS = ROOT / "docs"
SETTINGS = (ROOT / "mkdocs.yml").read_text()


def test_every_page_is_in_the_navigation():
    pages = {str(path.relative_to(DOCS)) for path in DOCS.rglob("*.md")}
    assert pages == set(re.findall(r": ([\w./-]+\.md)$", SETTINGS, re.MULTILINE))


def test_what_pages_include_is_there():
    for page in DOCS.rglob("*.md"):
        for name in re.findall(r'--8<-- "(.+?)"', page.read_text()):
            assert (ROOT / name).stat().st_size > 100, name


@pytest.mark.slow
def test_the_site_fetches_nothing_and_its_search_works_from_a_folder(tmp_path):
    command = [sys.executable, "-m", "mkdocs", "build", "--strict", "--quiet", "-d", tmp_path]
    settings = {**os.environ, "NO_MKDOCS_2_WARNING": "1"}
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, env=settings)
    assert (done.returncode, done.stdout + done.stderr) == (0, "")
    for page in tmp_path.rglob("*.html"):
        fetched = re.findall(
            r'<(?:script|img|iframe|link)\b[^>]*(?:src|href)="?(\w+:)?//', page.read_text()
        )
        assert not fetched, page
    index = (tmp_path / "search" / "search_index.js").read_text()
    assert "flux-linkage" in index
    assert (tmp_path / "vendor" / "iframe-worker.js").exists()
