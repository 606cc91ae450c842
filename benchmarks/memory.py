"""Whether memory stays: of `mpvi serve` over many clients, and of one process over many episodes.

    python -m benchmarks.memory serve --clients 1000
    python -m benchmarks.memory episodes --episodes 20

Clients come eight at a time. Each says what its labels are called, asks the policy `reactive` three times, with the
pictures that it wants, and goes. Episodes are the first ten seconds of a unit of the same policy. What is told is
resident memory [MB] as it goes, and its slope over the second half.
"""

from __future__ import annotations

import argparse
import gc
import json
import os
import re
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np

AT_ONCE = 8
TREE = "tree: short\nroot:\n  timeout: 10\n  child: {manipulate: pick up a can of soda with the right hand}\n"


def resident_mb(pid: int) -> float:
    """Resident memory of a process [MB]."""
    told = re.search(r"^VmRSS:\s+(\d+) kB", Path(f"/proc/{pid}/status").read_text(), re.MULTILINE)
    assert told is not None
    return int(told[1]) / 1000


def served(clients: int) -> Iterator[float]:
    """Resident memory of a server [MB] after each of twenty parts of the clients."""
    from mpvi_bt.remote.openpi import OpenpiPolicy
    from tests.serving import observation

    command = [sys.executable, "-m", "mpvi_bt.cli", "serve", "reactive", "--port", "0", "--json"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True) as process:
        assert process.stdout is not None
        address = json.loads(process.stdout.readline())["address"]
        seen = observation("pick up the cup", size=224)

        def come_and_go(number: int) -> None:
            policy = OpenpiPolicy(address, "mpvi", {"cup.n.01_1": ["cup"]})
            policy.reset()
            for _ in range(3):
                policy.infer(seen)
            policy.close()

        with ThreadPoolExecutor(AT_ONCE) as pool:
            for part in np.array_split(np.arange(clients), 20):
                list(pool.map(come_and_go, part))
                yield resident_mb(process.pid)
        process.terminate()


def played(episodes: int) -> Iterator[float]:
    """Resident memory of this process [MB] after each episode."""
    from mpvi_bt.choices.config import EpisodeConfig
    from mpvi_bt.episode.episode import run

    with tempfile.TemporaryDirectory() as folder:
        tree = Path(folder) / "short.yaml"
        tree.write_text(TREE)
        for seed in range(episodes):
            run(EpisodeConfig("picking_up_trash", seed=seed, policy="reactive", tree=str(tree)))
            gc.collect()
            yield resident_mb(os.getpid())


def main() -> None:
    """Print resident memory as it goes, and its slope."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("what", choices=["serve", "episodes"])
    parser.add_argument("--clients", type=int, default=1000)
    parser.add_argument("--episodes", type=int, default=20)
    given = parser.parse_args()
    count = given.clients if given.what == "serve" else given.episodes
    rows: list[float] = []
    for mb in served(count) if given.what == "serve" else played(count):
        rows.append(mb)
        print(f"{mb:.0f}", end=" ", flush=True)
    half = rows[len(rows) // 2 :]
    slope = np.polyfit(np.arange(len(half)), half, 1)[0] * len(rows) / count
    each = "client" if given.what == "serve" else "episode"
    print(f"\n{count} {each}s: {rows[0]:.0f} MB at first, {max(rows):.0f} MB at most, {slope:+.3f} MB a {each}")


if __name__ == "__main__":
    main()
