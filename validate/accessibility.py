"""Pages examined by axe-core in headless Chromium: ``python -m validate.accessibility PAGE...``.

PAGE is an HTML file, such as a ``report.html`` or one of ``out/site``. Each is examined at 1400 and
420 px, in light and in dark. Printed is a line for each rule that is broken, with its impact and an
element; nothing serious or critical should be among them. It needs Chromium or Chrome, and
axe-core: ``pip install axe-core-python``.
"""

import html
import importlib.util
import json
import re
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

_BROWSERS = ("chromium", "chromium-browser", "google-chrome")
_SERIOUS = ("serious", "critical")
# A policy would keep the page from running what is added.
_POLICY = re.compile(r"<meta[^>]*Content-Security-Policy[^>]*>", re.IGNORECASE)
_ASK = """
window.addEventListener("load", () => setTimeout(() => axe.run().then(found => {
  const kept = document.createElement("pre");
  kept.textContent = "AXE" + JSON.stringify(found.violations.map(one => [
    one.impact, one.id, one.nodes.length, one.nodes[0].html.slice(0, 120)])) + "EXA";
  document.body.appendChild(kept);
}), 1500));
"""


def violations(page: Path, browser: str, axe: str, width: int, dark: bool) -> list[list[Any]]:
    """Return impact, rule, number of elements and the first of them, of each rule broken."""
    text = _POLICY.sub("", page.read_text(encoding="utf-8"))
    added = f"<script>{axe}</script><script>{_ASK}</script>"
    with tempfile.TemporaryDirectory(dir=page.parent) as folder:
        # Beside the page, and read as if in its place, so that what it refers to is found.
        copy = Path(folder) / page.name
        base = f'<base href="{page.parent.as_uri()}/">'
        copy.write_text(text.replace("<head>", f"<head>{base}", 1) + added, encoding="utf-8")
        command = [browser, "--headless", "--no-sandbox", "--disable-gpu", "--dump-dom"]
        command += ["--allow-file-access-from-files", "--virtual-time-budget=60000"]
        command += [f"--window-size={width},2400", *(["--force-dark-mode"] if dark else [])]
        done = subprocess.run(
            [*command, copy.as_uri()], capture_output=True, text=True, timeout=600, check=True
        )
    found = re.search(r"AXE(\[.*\])EXA", done.stdout, re.DOTALL)
    if found is None:
        raise SystemExit(f"{page}: axe-core did not answer.")
    answer: list[list[Any]] = json.loads(html.unescape(found[1]))
    return answer


def rows(pages: list[Path], browser: str, axe: str) -> Iterator[tuple[str, bool]]:
    """Yield a line and whether it is serious, for each page, width and scheme."""
    for page in pages:
        for width, dark in ((1400, False), (1400, True), (420, False), (420, True)):
            where = f"{page} {width} px {'dark' if dark else 'light'}"
            broken = violations(page.resolve(), browser, axe, width, dark)
            if not broken:
                yield f"{where}: nothing", False
            for impact, rule, count, element in broken:
                serious = impact in _SERIOUS
                yield f"{where}: {impact} {rule}, {count} elements: {element}", serious


def main() -> None:
    """Print the lines; exit status 1 where one is serious."""
    browser = next(filter(None, map(shutil.which, _BROWSERS)), None)
    package = importlib.util.find_spec("axe_core_python")
    if browser is None or package is None or package.origin is None:
        raise SystemExit("needs Chromium or Chrome, and: pip install axe-core-python")
    axe = (Path(package.origin).parent / "axe.min.js").read_text(encoding="utf-8")
    serious = 0
    for line, counts in rows([Path(one) for one in sys.argv[1:]], browser, axe):
        print(line, flush=True)
        serious += counts
    print(f"{serious} serious or critical")
    raise SystemExit(bool(serious))


if __name__ == "__main__":
    main()
