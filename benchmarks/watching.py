"""What `--serve` adds to the time of a tick: without a visitor, and with two.

    python -m benchmarks.watching

The tree of `ticking.py`, traced, one of its rules beginning or ending to apply every 30 ticks: ticked bare, and with a
page. The sides take turns within one run, so that noise meets both; while the bare side ticks, the page's process is
stopped, so that what it takes from the cores counts against the other.
"""

from __future__ import annotations

import itertools
import json
import multiprocessing
import signal
import statistics
import tempfile
import time
import urllib.parse
import urllib.request
from collections.abc import Callable
from multiprocessing.sharedctypes import Synchronized
from pathlib import Path

from benchmarks.ticking import ours, ratio, reactive
from mpvi_bt.apps.watch.address import Address
from mpvi_bt.apps.watch.channel import Page
from mpvi_bt.apps.watch.pictures import LivePictures
from mpvi_bt.runs.recording.recorder import Recorder
from mpvi_bt.testing import KinematicWorld

ROUNDS, TICKS, RINGS = 150, 60, 30  # a round is a quarter of a second or more, longer than between two events


def ticker(trace: Path, page: Page | None) -> Callable[[], None]:
    """One tick of the tree, traced, with or without a page."""
    tree, world = ours(reactive(23)), KinematicWorld()
    watchers = [Recorder(trace), *([LivePictures(page)] if page else [])]
    for watcher in watchers:
        watcher.start(tree, world)
    count = itertools.count(1)

    def tick() -> None:
        if next(count) % RINGS == 0:
            tree.context.blackboard["bell"] = not tree.context.blackboard["bell"]
        tree.tick()
        for watcher in watchers:
            watcher.step(tree, world)

    return tick


def visit(url: str, told: Synchronized[int]) -> None:
    """Be a visitor: read events until the server ends, and count them."""
    with urllib.request.urlopen(url) as answer:
        text = answer.read().decode()
    since = json.loads(text.split('type="application/json">', 1)[1].split("</script>", 1)[0])["live"]["since"]
    with urllib.request.urlopen(f"{url}events?since={urllib.parse.quote(since)}") as answer:
        for line in answer:
            with told.get_lock():
                told.value += line.startswith(b"data: ")


def compare(visitors: int) -> tuple[list[float], list[float], int]:
    """Time of a tick [s] in each round, bare and served, and how many events visitors got."""
    with tempfile.TemporaryDirectory() as folder:
        served = Path(folder, "served.jsonl")
        page = Page(Address().bound(), served)
        told: Synchronized[int] = multiprocessing.Value("i", 0)
        times: tuple[list[float], list[float]] = ([], [])
        try:
            sides = [ticker(Path(folder, "bare.jsonl"), None), ticker(served, page)]
            wait_for(page.url)
            guests = [multiprocessing.Process(target=visit, args=(page.url, told)) for _ in range(visitors)]
            for guest in guests:
                guest.start()
            time.sleep(1)
            for at in range(ROUNDS):
                for side in (0, 1) if at % 2 else (1, 0):
                    page.process.send_signal(signal.SIGCONT if side else signal.SIGSTOP)
                    began = time.perf_counter()
                    for _ in range(TICKS):
                        sides[side]()
                    times[side].append((time.perf_counter() - began) / TICKS)
        finally:
            page.process.send_signal(signal.SIGCONT)
            page.close()
        for guest in guests:
            guest.join()
        return *times, told.value


def wait_for(url: str) -> None:
    """Until the page is served."""
    for _ in range(200):
        try:
            urllib.request.urlopen(url).close()
            return
        except OSError:
            time.sleep(0.05)


def main() -> None:
    """Print the comparison."""
    for visitors in (0, 2):
        bare, watched, told = compare(visitors)
        bare_us, watched_us = 1e6 * statistics.median(bare), 1e6 * statistics.median(watched)
        more = 100 * (ratio(watched, bare) - 1)
        print(f"{visitors} visitors: {bare_us:.0f} us bare, {watched_us:.0f} us served, {more:+.2f} %, {told} events")


if __name__ == "__main__":
    main()
