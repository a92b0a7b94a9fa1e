"""A person without a mouse: every picture of a report is reached with TAB and obeys its keys."""

import json
import os
import shutil
import subprocess
import time

import numpy as np
import pytest

from penode.report import panels
from penode.report.document import Document, Figure, Section
from penode.report.html import render

CHROMIUM = next(
    filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None
)
FOCUSED = "document.activeElement.dataset.plot || document.activeElement.textContent"


class Browser:
    """Chromium without a window, told what to do through a pair of pipes."""

    def __init__(self, profile):
        theirs, self._write = os.pipe()
        self._read, answers = os.pipe()
        command = [
            CHROMIUM, "--headless", "--no-sandbox", "--disable-gpu", "--disable-quic",
            "--no-first-run", "--disable-background-networking", "--disable-component-update",
            "--disable-sync", "--remote-debugging-pipe", f"--user-data-dir={profile}",
        ]  # fmt: skip
        # Chromium listens on 3 and answers on 4.
        redirected = ["bash", "-c", f'exec "$@" 3<&{theirs} 4>&{answers}', "bash", *command]
        self._process = subprocess.Popen(
            redirected, pass_fds=(theirs, answers), stderr=subprocess.DEVNULL
        )
        os.close(theirs)
        os.close(answers)
        self._number, self._session, self._rest = 0, None, b""
        target = self.ask("Target.createTarget", url="about:blank")["targetId"]
        attached = self.ask("Target.attachToTarget", targetId=target, flatten=True)
        self._session = attached["sessionId"]

    def ask(self, method, **parameters):
        self._number += 1
        message = {"id": self._number, "method": method, "params": parameters}
        if self._session:
            message["sessionId"] = self._session
        os.write(self._write, json.dumps(message).encode() + b"\0")
        while True:
            answer = self._next()
            if answer.get("id") == self._number:
                assert "error" not in answer, answer
                return answer["result"]

    def evaluate(self, expression):
        found = self.ask("Runtime.evaluate", expression=expression)["result"]
        return found.get("value")

    def press(self, key, code):
        event = {"key": key, "code": key, "windowsVirtualKeyCode": code}
        text = {"text": key} if len(key) == 1 else {}
        self.ask("Input.dispatchKeyEvent", type="keyDown", **event, **text)
        self.ask("Input.dispatchKeyEvent", type="keyUp", **event)

    def close(self):
        self._process.terminate()
        self._process.wait(30)
        os.close(self._write)
        os.close(self._read)

    def _next(self):
        while b"\0" not in self._rest:
            part = os.read(self._read, 1 << 16)
            assert part, "Chromium went away"
            self._rest += part
        message, _, self._rest = self._rest.partition(b"\0")
        return json.loads(message)


@pytest.fixture
def browser(tmp_path):
    opened = Browser(tmp_path / "profile")
    yield opened
    opened.close()


def line(title):
    plot = panels.blank_figure()
    plot.add_scatter(x=np.arange(5.0), y=np.arange(5.0) ** 2, name="square")
    for sign in (-1, 1):
        plot.add_scatter(x=[0.0, 4.0], y=[0.0, 4.0 * sign], name="lines", legendgroup="lines")
    plot.update_layout(showlegend=title == "One")
    return Figure(title, "Caption.", plot)


DRAWN = "document.documentElement.hasAttribute('data-drawn')"


@pytest.mark.skipif(CHROMIUM is None or shutil.which("bash") is None, reason="No Chromium here.")
def test_pictures_are_reached_and_moved_by_keys(browser, tmp_path):
    page = tmp_path / "page.html"
    sections = [Section("First", "", [line("One")]), Section("Second", "", [line("Two")])]
    page.write_text(render(Document("Kind", "Title", "Lead", [], sections)), encoding="utf-8")
    browser.ask("Page.enable")
    browser.ask("Page.navigate", url=page.as_uri())
    for _ in range(600):
        if browser.evaluate(DRAWN):
            break
        time.sleep(0.1)
    else:
        pytest.fail("The figures were never drawn.")

    reached = []
    for _ in range(30):
        browser.press("Tab", 9)
        reached.append(browser.evaluate(FOCUSED))
    first, second = (
        browser.evaluate(f"document.querySelectorAll('[data-plot]')[{k}].dataset.plot")
        for k in (0, 1)
    )
    assert {first, second} <= set(reached)
    assert reached.count("Reset view") >= 2

    while browser.evaluate(FOCUSED) != first:
        browser.press("Tab", 9)
    ends = "JSON.stringify(document.activeElement._fullLayout.xaxis.range)"
    before = np.array(json.loads(browser.evaluate(ends)))
    browser.press("+", 187)
    closer = np.array(json.loads(browser.evaluate(ends)))
    assert np.ptp(closer) == pytest.approx(0.7 * np.ptp(before))
    browser.press("0", 48)
    assert json.loads(browser.evaluate(ends)) == pytest.approx(before)

    # The digits do what a click on the legend does, to a whole group; a hidden legend has none.
    shown = "document.activeElement._fullData.map((trace) => trace.visible).join()"
    browser.press("2", 50)
    assert browser.evaluate(shown) == "true,legendonly,legendonly"
    browser.press("2", 50)
    browser.press("9", 57)
    assert browser.evaluate(shown) == "true,true,true"
    while browser.evaluate(FOCUSED) != second:
        browser.press("Tab", 9)
    browser.press("1", 49)
    assert browser.evaluate(shown) == "true,true,true"
