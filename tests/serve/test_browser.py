"""A served scene in a real browser: Debian's chromium without a screen, with pictures drawn in software."""

import io
import json
import re
import shutil
import signal
import subprocess
import sys
import time
import tomllib

import numpy as np
import pytest
from PIL import Image

from tests.conftest import heed_interrupts

pytest.importorskip("viser", reason="needs the extra web")
playwright = pytest.importorskip("playwright.sync_api", reason="needs playwright, of the extra dev")
CHROMIUM = shutil.which("chromium")
pytestmark = pytest.mark.skipif(CHROMIUM is None, reason="needs Debian's package chromium")

TOKEN = "a-token-of-the-tests"
SCENE = """
title = "A cube on the ground"
dimension = 3
gravity = [0.0, -9.81, 0.0]

[[bodies]]
name = "cube"
position = [0.0, 0.25, 0.0]
shape = { kind = "box", size = [0.5, 0.5, 0.5], cells = [4, 4, 4] }
material = { youngs_modulus = 1e5, damping_ratio = 0.3, density = 1000.0 }
color = "#ff0000"

[[colliders]]
kind = "half_space"
point = [0.0, 0.0, 0.0]
normal = [0.0, 1.0, 0.0]
friction = 0.8

[render.camera]
eye = [0.0, 0.9, 3.5]
target = [0.0, 0.6, 0.0]
"""
PLAIN_EDGES = """
const context = HTMLCanvasElement.prototype.getContext;
HTMLCanvasElement.prototype.getContext = function (kind, options) {
    return context.call(this, kind, { ...options, antialias: false });
};
"""
"""Antialiasing takes half of the time where pictures are drawn in software."""


@pytest.fixture(scope="module")
def browser():
    with playwright.sync_playwright() as engine:
        one = engine.chromium.launch(
            executable_path=CHROMIUM,
            args=["--headless=new", "--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"],
        )
        yield one
        one.close()


@pytest.fixture
def served(tmp_path):
    """A scene that is served to others with a token: its address, and how to end it."""
    (tmp_path / "cube.toml").write_text(SCENE)
    command = [sys.executable, "-m", "sandbox", "serve", "cube.toml", "--no-shadows", "--record", "done.toml"]
    command += ["--host", "0.0.0.0", "--port", "0", "--token", TOKEN]
    child = subprocess.Popen(command, cwd=tmp_path, stdout=subprocess.PIPE, text=True, preexec_fn=heed_interrupts)
    line = child.stdout.readline()
    address = re.sub(r"//[^:]+:", "//127.0.0.1:", re.search(r"http\S+", line)[0])

    def end():
        child.send_signal(signal.SIGINT)
        printed, _ = child.communicate(timeout=20)
        return child.returncode, printed, tomllib.loads((tmp_path / "done.toml").read_text())

    yield address, end
    child.kill()
    child.wait()


def show(browser, address):
    """Open the page as a visitor of its own, since those share cookies, and wait until the scene is drawn."""
    page = browser.new_context(viewport={"width": 640, "height": 300}).new_page()
    page.add_init_script(PLAIN_EDGES)
    page.goto(address)
    page.wait_for_selector("#readings", timeout=60_000)
    page.add_style_tag(content=".mantine-Notifications-root { display: none }")
    wait_for(lambda: cube(page) is not None)
    return page


def cube(page):
    """Where the middle of what is red is in the page [pixels], x to the right and y down; None while nothing is."""
    picture = np.asarray(Image.open(io.BytesIO(page.screenshot())).convert("RGB"), dtype=int)[:, :315]
    red = (picture[..., 0] > 80) & (picture[..., 0] > 2 * picture[..., 1]) & (picture[..., 0] > 2 * picture[..., 2])
    return None if red.sum() < 50 else np.argwhere(red).mean(axis=0)[::-1]


def wait_for(condition, seconds=30.0):
    end = time.perf_counter() + seconds
    while not condition():
        assert time.perf_counter() < end, "it never came to be so"
        time.sleep(0.05)


def pull_up(page, pixels):
    """Take the cube in the middle with the mouse, and hold it higher; where it was."""
    x, y = cube(page)
    page.mouse.move(x, y)
    page.mouse.down()
    for way in np.linspace(0.0, pixels, 8):
        page.mouse.move(x, y - way)
        time.sleep(0.03)
    return y


def test_a_body_follows_the_mouse_and_the_recording_does_it_again(browser, served, tmp_path, run_cli, monkeypatch):
    address, end = served
    page = browser.new_page()
    assert page.goto(address.partition("?")[0]).status == 401
    assert "token is needed" in page.inner_text("body") and page.query_selector("canvas") is None
    page.close()
    page = show(browser, address)
    assert "token" not in page.url
    start = pull_up(page, 60.0)
    wait_for(lambda: cube(page)[1] < start - 30.0)
    page.mouse.up()
    wait_for(lambda: cube(page)[1] > start - 15.0)
    code, printed, record = end()
    page.context.close()
    assert code == 0 and printed.count("\n") == 1 and "done.toml" in printed
    (grab,) = record["actions"]
    assert grab["kind"] == "grab" and len(grab["path"]) > 1
    assert grab["path"][-1]["position"][1] > grab["point"][1] + 0.2
    monkeypatch.chdir(tmp_path)
    code, printed, _ = run_cli("run", "cube.toml", "--actions", "done.toml", "--renderer", "none", "--json")
    assert code == 0
    assert json.loads(printed)["state_sha256"] == record["recording"]["state_sha256"]


def test_two_browsers_see_the_same_and_one_that_vanishes_lets_go(browser, served):
    address, end = served
    one, other = show(browser, address), show(browser, address)
    start = cube(other)[1]
    pull_up(one, 60.0)
    wait_for(lambda: cube(other)[1] < start - 30.0)
    one.context.close()
    wait_for(lambda: cube(other)[1] > start - 15.0)
    pull_up(other, 60.0)
    wait_for(lambda: cube(other)[1] < start - 30.0)
    code, _, record = end()
    other.context.close()
    assert code == 0
    first, second = record["actions"]
    assert first["end"] < second["start"]
    assert record["recording"]["ticks"] * record["recording"]["tick"] > second["start"]
