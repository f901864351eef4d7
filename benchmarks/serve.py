"""How many pictures a second of a served scene reach a browser, and are drawn there.

A wobbling ball of some 5,000 surface vertices is served to chromium without a screen. Counted in
the page are batches of messages that arrive, and new vertices that are handed to WebGL; in the server pictures that are
sent, and what one costs. WebGL runs in software here, on the cores that simulate, so its antialiasing, which takes half
of that time, is switched off unless asked for. Needs the extra dev and Debian's chromium.
"""

import argparse
import shutil
import tempfile
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import trimesh.creation
from playwright.sync_api import Page, sync_playwright

from sandbox import Scene
from sandbox.scene.load import scene_from_data
from sandbox.serve.access import Access
from sandbox.serve.host import Host
from sandbox.serve.listener import open_port, serving
from sandbox.session import Session

ARGUMENTS = ["--headless=new", "--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]
PLAIN_EDGES = """
const context = HTMLCanvasElement.prototype.getContext;
HTMLCanvasElement.prototype.getContext = function (kind, options) {
    return context.call(this, kind, { ...options, antialias: false });
};
"""
COUNTERS = """
window.arrived = window.drawn = window.frames = 0;
const SIZE = %d;
const upload = WebGL2RenderingContext.prototype.bufferSubData;
WebGL2RenderingContext.prototype.bufferSubData = function (target, offset, data) {
    // Vertices are views into what came over the network; normals, of the same size, are computed in the page.
    if (data && data.length === SIZE && data.buffer.byteLength > data.byteLength) window.drawn++;
    return upload.apply(this, arguments);
};
const Plain = window.Worker;
window.Worker = class extends Plain {
    constructor(...given) {
        super(...given);
        this.addEventListener("message", (event) => {
            const messages = (event.data && event.data.messages) || [];
            if (messages.some((one) => one.updates && one.updates.vertices)) window.arrived++;
        });
    }
};
(function next() { window.frames++; requestAnimationFrame(next); })();
"""


def ball(folder: Path) -> Scene:
    """A ball of some hundred particles that carry a fine surface, held at its foot: it wobbles, and is no work."""
    trimesh.creation.uv_sphere(radius=0.5, count=[72, 36]).export(folder / "ball.ply")
    return scene_from_data(
        {
            "dimension": 3,
            "gravity": [4.0, -9.81, 0.0],
            "solver": {"integrator": "velocity_verlet"},
            "bodies": [
                {
                    "name": "ball",
                    "shape": {"kind": "mesh", "file": str(folder / "ball.ply"), "cells": 8},
                    "material": {"youngs_modulus": 3e4, "density": 1000.0},
                    "pin": {"region": {"min": [-1.0, -1.0, -1.0], "max": [1.0, -0.3, 1.0]}},
                }
            ],
        },
        None,
    )


def counted(page: Page, host: Host, seconds: float) -> dict[str, float]:
    """What happens a second, in the page and in the server, over some seconds."""

    def now() -> dict[str, float]:
        page_counts = page.evaluate("({arrived, drawn, frames})")
        return {**page_counts, "sent": host.pictures, "simulated": host.session.simulation.time}

    start, before = time.perf_counter(), now()
    time.sleep(seconds)
    after, span = now(), time.perf_counter() - start
    return {name: (after[name] - before[name]) / span for name in before}


def timed(function: Callable[..., Any], record: list[float]) -> Callable[..., Any]:
    """The same function, with its wall times recorded [s]."""

    def call(*given: Any) -> Any:
        start = time.perf_counter()
        result = function(*given)
        record.append(time.perf_counter() - start)
        return result

    return call


def watch(host: Host, port: int, size: str, seconds: float, antialias: bool) -> None:
    """Open the page and print what is counted."""
    width, height = (int(part) for part in size.split("x"))
    with sync_playwright() as engine:
        browser = engine.chromium.launch(executable_path=shutil.which("chromium"), args=ARGUMENTS)
        page = browser.new_page(viewport={"width": width, "height": height})
        if not antialias:
            page.add_init_script(PLAIN_EDGES)
        page.add_init_script(COUNTERS % (3 * host.stage.vertex_count))
        page.goto(f"http://127.0.0.1:{port}")
        page.wait_for_function("drawn > 10", timeout=120_000)
        time.sleep(8.0)  # Shaders are compiled at first.
        costs: list[float] = []
        host.stage.show = timed(host.stage.show, costs)  # type: ignore[method-assign]
        rates = counted(page, host, seconds)
        cost = 1e3 * sorted(costs)[len(costs) // 2]
        print(
            f"{1 / host.pace.picture:7.0f} {host.stage.vertex_count:9,d} {size:>9s} {rates['sent']:8.1f} {cost:9.2f}"
            f" {1e3 * host.pace.tick_cost * host.pace.picture / host.pace.tick:11.2f} {rates['simulated']:10.2f}"
            f" {rates['arrived']:9.1f} {rates['drawn']:7.1f} {rates['frames']:8.1f}",
            flush=True,
        )
        browser.close()


def measure(scene: Scene, pictures: float, size: str, seconds: float, shadows: bool, antialias: bool) -> None:
    """Serve the scene, and watch it."""
    with open_port("127.0.0.1", 0) as listening:
        port = listening.getsockname()[1]
        with serving(listening, Access.of("127.0.0.1")) as server:
            host = Host(Session(scene), server, pictures, shadows)
            host.warm_up()
            stop = threading.Event()

            def watch_and_stop() -> None:
                try:
                    watch(host, port, size, seconds, antialias)
                finally:
                    stop.set()

            watcher = threading.Thread(target=watch_and_stop)
            watcher.start()
            host.run(stop)
            watcher.join()


def main() -> None:
    """Measure at 30 pictures a second, and at the usual rate."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=10.0)
    parser.add_argument("--size", default="480x270", help="of the page; without a GPU every pixel is dear")
    parser.add_argument("--shadows", action="store_true")
    parser.add_argument("--antialias", action="store_true")
    options = parser.parse_args()
    print("                               server: a second, ms a picture         page: a second")
    print(" wanted  vertices      page     sent   sending  simulating  simulated   arrived   drawn   frames")
    with tempfile.TemporaryDirectory() as folder:
        scene = ball(Path(folder))
        for pictures in (30.0, 60.0):
            measure(scene, pictures, options.size, options.seconds, options.shadows, options.antialias)


if __name__ == "__main__":
    main()
