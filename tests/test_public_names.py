"""The public names are in five namespaces: pages, examples and notebooks use these alone."""

import ast
import importlib
import json
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
NAMESPACES = ("penode", "penode.engine", "penode.pmsm", "penode.bench", "penode.paper")
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]
# But for the one that draws what stands behind the page of the theory, from inside.
DRAWN = [p for p in sorted((ROOT / "docs").rglob("*.py")) if p.name != "horizon_theory.py"]
SCRIPTS = [*sorted((ROOT / "examples").glob("*.py")), *DRAWN]
NOTEBOOKS = sorted((ROOT / "notebooks").glob("*.ipynb"))


def code(path: Path) -> str:
    """Return the Python of a script, of a page's blocks, or of a notebook's cells."""
    text = path.read_text()
    if path.suffix == ".md":
        return "\n".join(re.findall(r"```python\n(.*?)```", text, flags=re.DOTALL))
    if path.suffix == ".ipynb":
        cells = json.loads(text)["cells"]
        return "\n".join("".join(c["source"]) for c in cells if c["cell_type"] == "code")
    return text


def imported(source: str) -> set[tuple[str, str]]:
    """Return the names that a source imports from penode, each with its module."""
    found = set()
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.ImportFrom) and (node.module or "").split(".")[0] == "penode":
            found |= {(node.module, alias.name) for alias in node.names}
        if isinstance(node, ast.Import):
            found |= {(a.name, "") for a in node.names if a.name.split(".")[0] == "penode"}
    return found


@pytest.mark.parametrize(
    "path", [*PAGES, *SCRIPTS, *NOTEBOOKS], ids=lambda path: str(path.relative_to(ROOT))
)
def test_imports_come_from_the_public_namespaces(path):
    for module, name in imported(code(path)):
        assert module in NAMESPACES, f"from {module} import {name}"
        assert not name or name in importlib.import_module(module).__all__, f"{module}.{name}"


@pytest.mark.parametrize("namespace", NAMESPACES)
def test_dir_shows_the_public_names_and_no_others(namespace):
    module = importlib.import_module(namespace)
    assert dir(module) == sorted(module.__all__)
    assert len(set(module.__all__)) == len(module.__all__)
    assert all(hasattr(module, name) for name in module.__all__)


def test_no_module_inside_imports_a_public_namespace():
    for path in (ROOT / "src" / "penode").rglob("*.py"):
        if path.name == "__init__.py":
            continue
        modules = {module for module, _ in imported(path.read_text())}
        assert not modules & set(NAMESPACES), path


@pytest.mark.parametrize("namespace", NAMESPACES)
def test_reference_pages_have_every_public_name(namespace):
    pages = [page.read_text() for page in sorted((ROOT / "docs" / "reference").glob("*.md"))]
    text = "\n".join(pages)
    described = re.findall(r"^::: (\S+)$", text, flags=re.MULTILINE)
    assert len(set(described)) == len(described)
    # Constants and namespaces are named in the text.
    near = "\n".join(page for page in pages if f"`{namespace}`" in page)
    for name in importlib.import_module(namespace).__all__:
        full = f"{namespace}.{name}"
        known = {full, f"{full}.{name}"}  # `penode.identify` is also the module of that function
        named = f"`{full}`" in text or re.search(rf"`{name}(\(\))?`", near)
        assert named or known & set(described), full


def test_reference_pages_describe_public_names_alone():
    for page in sorted((ROOT / "docs" / "reference").glob("*.md")):
        for full in re.findall(r"^::: (\S+)$", page.read_text(), flags=re.MULTILINE):
            namespace, _, name = full.removesuffix(".identify.identify").rpartition(".")
            if full.endswith(".identify.identify"):
                namespace, name = full.removesuffix(".identify.identify"), "identify"
            assert name in importlib.import_module(namespace).__all__, full
