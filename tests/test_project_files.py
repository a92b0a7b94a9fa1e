"""The files around the library say the same as the library: version, extras, licences, contents."""

import re
import shutil
import subprocess
import sys
import tarfile
import tomllib
from fnmatch import fnmatch
from pathlib import Path

import pytest
import yaml

import penode

ROOT = Path(__file__).parents[1]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
EXTRAS = PROJECT["optional-dependencies"]


def names(requirements):
    return {re.match(r"[\w-]+", one)[0] for one in requirements} - {"penode"}


def test_one_version_everywhere():
    version = PROJECT["version"]
    assert penode.__version__ == version
    assert yaml.safe_load((ROOT / "CITATION.cff").read_text())["version"] == version
    changelog = (ROOT / "CHANGELOG.md").read_text()
    assert re.search(rf"^## \[{re.escape(version)}\] - \d{{4}}-\d\d-\d\d$", changelog, re.MULTILINE)
    assert f"[{version}]: {PROJECT['urls']['Source']}/releases/tag/v{version}" in changelog


def test_the_changelog_keeps_its_form():
    headings = re.findall(r"^#{2,3} (.*)$", (ROOT / "CHANGELOG.md").read_text(), re.MULTILINE)
    assert headings[0] == "[Unreleased]"
    kinds = {"Added", "Changed", "Deprecated", "Removed", "Fixed", "Security"}
    assert {one for one in headings if not one.startswith("[")} <= kinds


def test_every_library_is_in_the_notice_with_its_extra():
    lines = (ROOT / "NOTICE").read_text().splitlines()
    noted = {
        name for line in lines if line.startswith("  ") for name in line.split("  ")[1].split(", ")
    }
    installed = {extra: kinds for extra, kinds in EXTRAS.items() if extra not in ("all", "dev")}
    assert noted - {"jaxlib"} == names(PROJECT["dependencies"]).union(
        *map(names, installed.values())
    )
    for extra, libraries in installed.items():
        for library in names(libraries):
            line = next(line for line in lines if line.startswith(f"  {library} "))
            assert line.endswith(f"penode[{extra}]")


def test_extras_that_refusals_name_exist():
    text = "".join(path.read_text() for path in (ROOT / "src").rglob("*.py"))
    named = {one for group in re.findall(r"penode\[([\w,]+)\]", text) for one in group.split(",")}
    named |= set(re.findall(r'require_extra\("\w+", "(\w+)"', text))
    assert {"plot", "hdf5", "mdf"} <= named <= set(EXTRAS)


@pytest.mark.parametrize(
    "path",
    [*ROOT.glob(".github/**/*.yml"), ROOT / ".pre-commit-config.yaml", ROOT / "CITATION.cff"],
)
def test_yaml_is_yaml(path):
    assert isinstance(yaml.safe_load(path.read_text()), dict)


def test_workflows_try_every_python_that_is_promised():
    jobs = yaml.safe_load((ROOT / ".github/workflows/ci.yml").read_text())["jobs"]
    promised = {
        one.split(":: ")[-1] for one in PROJECT["classifiers"] if re.search(r"3\.\d+$", one)
    }
    assert set(jobs["tests"]["strategy"]["matrix"]["python"]) == promised
    assert f">={min(promised, key=lambda one: int(one[2:]))}" == PROJECT["requires-python"]
    makefile = (ROOT / "Makefile").read_text()
    targets = {
        s["run"].split()[1]
        for j in jobs.values()
        for s in j["steps"]
        if "make " in s.get("run", "")
    }
    assert all(re.search(rf"^{target}:", makefile, re.MULTILINE) for target in targets)


def test_the_source_distribution_is_told_of_every_file():
    if not (ROOT / ".git").exists() or shutil.which("git") is None:
        pytest.skip("no checkout")
    listed = subprocess.run(
        ["git", "ls-files"], cwd=ROOT, capture_output=True, text=True, check=True
    )
    rules = [line.split() for line in (ROOT / "MANIFEST.in").read_text().splitlines()]
    single = {one for kind, *rest in rules if kind == "include" for one in rest}
    folders = {rest[0]: rest[1:] for kind, *rest in rules if kind == "recursive-include"}
    # What setuptools includes unasked.
    single |= {"README.md", "LICENSE", "NOTICE", "MANIFEST.in", "pyproject.toml"}
    for file in listed.stdout.splitlines():
        folder, name = file.split("/")[0], file.split("/")[-1]
        patterns = folders.get(folder, ["*"] if folder == "src" else [])
        assert file in single or any(fnmatch(name, one) for one in patterns), file


@pytest.mark.slow
def test_the_distributions_build_without_a_warning(tmp_path):
    command = [sys.executable, "-m", "uv", "build", "--out-dir", tmp_path, ROOT]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    assert (
        "warning"
        not in (done.stdout + done.stderr).replace("byte-compiling is disabled", "").lower()
    )
    (archive,) = tmp_path.glob("*.tar.gz")
    with tarfile.open(archive) as opened:
        assert any(name.endswith("tests/test_project_files.py") for name in opened.getnames())
