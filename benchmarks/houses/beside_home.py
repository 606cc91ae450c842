"""Episodes in drawn houses beside the same tasks in the family house: what a house that nobody looked at costs.

    python -m benchmarks.houses.beside_home FOLDER HOME

FOLDER has results of `mpvi run TASK --house generated:N --instance I --method expert --out FOLDER`, HOME those without
`--house` for the same tasks and start states. What has no partner is left out.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path

import click
import numpy as np

from benchmarks.origin import grid
from benchmarks.paired_results import change, paired, results
from mpvi_bt.runs.episode.result import Result
from mpvi_bt.runs.report.compare import SAME_Q


def rows(there: Sequence[Result], home: Sequence[Result]) -> Iterator[list[str]]:
    """A row a house, one of the means over houses, then one for each task whose q differs from that at home."""
    pairs = paired(there, home)
    houses: dict[str, list[tuple[float, float]]] = {}
    for new, old in sorted(pairs, key=lambda pair: str(pair[0].config["house"])):
        houses.setdefault(str(new.config["house"]), []).append((new.q, old.q))
    for house, q in houses.items():
        yield [house, f"{len(q)}", *(f"{mean:.2f}" for mean in np.mean(q, axis=0))]
    means = np.array([np.mean(q, axis=0) for q in houses.values()])
    told = f"mean of {len(houses)} houses; difference {change(means[:, 0] - means[:, 1])}"
    yield [told, f"{len(pairs)}", *(f"{q:.2f}" for q in means.mean(0))]
    for new, old in pairs:
        if abs(new.q - old.q) > SAME_Q:
            yield [f"`{new.task}` in {new.config['house']}", "1", f"{new.q:.2f}", f"{old.q:.2f}"]


@click.command()
@click.argument("folder", type=click.Path(path_type=Path, exists=True))
@click.argument("home", type=click.Path(path_type=Path, exists=True))
def main(folder: Path, home: Path) -> None:
    """Print what drawn houses cost."""
    click.echo(
        grid(["house", "episodes", "q there", "q in the family house"], list(rows(*map(results, (folder, home)))))
    )


if __name__ == "__main__":
    main()
