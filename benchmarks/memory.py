"""Whether the memory of `mpvi serve` stays over many clients; over episodes `python -m benchmarks.faults.soak` tells.

    python -m benchmarks.memory serve --clients 1000

Clients come eight at a time. Each says what its labels are called, asks the policy `reactive` three times, with the
pictures that it wants, and goes. What is told is resident memory [MB] as it goes, and its slope over the second half.
"""

from __future__ import annotations

import argparse
import json
import re
import subprocess
import sys
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np

AT_ONCE = 8


def resident_mb(pid: int) -> float:
    """Resident memory of a process [MB]."""
    told = re.search(r"^VmRSS:\s+(\d+) kB", Path(f"/proc/{pid}/status").read_text(), re.MULTILINE)
    assert told is not None
    return int(told[1]) / 1000


def served(clients: int) -> Iterator[float]:
    """Resident memory of a server [MB] after each of twenty parts of the clients."""
    from mpvi_bt.executive.remote.openpi import OpenpiPolicy
    from tests.serving import observation

    command = [sys.executable, "-m", "mpvi_bt.apps.cli", "serve", "reactive", "--port", "0", "--json"]
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


def main() -> None:
    """Print resident memory as it goes, and its slope."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("what", choices=["serve"])
    parser.add_argument("--clients", type=int, default=1000)
    count = parser.parse_args().clients
    rows: list[float] = []
    for mb in served(count):
        rows.append(mb)
        print(f"{mb:.0f}", end=" ", flush=True)
    half = rows[len(rows) // 2 :]
    slope = np.polyfit(np.arange(len(half)), half, 1)[0] * len(rows) / count
    print(f"\n{count} clients: {rows[0]:.0f} MB at first, {max(rows):.0f} MB at most, {slope:+.3f} MB a client")


if __name__ == "__main__":
    main()
