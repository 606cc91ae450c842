"""`python -m benchmarks.ros2`: whole episodes over ROS 2; `python -m benchmarks.ros2 faults`: robots that fail."""

from __future__ import annotations

from pathlib import Path

import click

from benchmarks.ros2 import episodes, faults
from benchmarks.rows import append, lines_of


@click.group(invoke_without_command=True)
@click.option("--task", "tasks", multiple=True, help="Only this; may be repeated.")
@click.option("--mcap", is_flag=True, help="Record each episode over ROS 2 into TASK.mcap, too.")
@click.option("--domain", type=int, default=63, show_default=True, help="ROS_DOMAIN_ID.")
@click.option("--out", type=click.Path(path_type=Path), default="runs/ros2_benchmark", show_default=True)
@click.pass_context
def main(ctx: click.Context, tasks: tuple[str, ...], mcap: bool, domain: int, out: Path) -> None:
    """Play tasks by `mpvi run` and by `mpvi ros2` in `mpvi ros2 house`; what is in the folder is not played again."""
    if ctx.invoked_subcommand is not None:
        return
    lines = []
    for task in tasks or episodes.TASKS:
        house, bridge = episodes.played_over_ros(task, out, domain, mcap)
        lines += episodes.rows(task, episodes.played_here(task, out), house, bridge)
        if mcap:
            click.echo(f"{task}.mcap: {(out / f'{task}.mcap').stat().st_size / 1e6:.1f} MB")
    click.echo(episodes.table(lines))


@main.command("faults")
@click.option("--count", type=int, default=20, show_default=True, help="Trials of each fault.")
@click.option("--fault", "chosen", multiple=True, type=click.Choice(faults.FAULTS), help="Only this; may be repeated.")
@click.option("--seed", type=int, default=0, show_default=True)
@click.option("--out", type=click.Path(path_type=Path), default="runs/ros2_faults.jsonl", show_default=True)
def play_faults(count: int, chosen: tuple[str, ...], seed: int, out: Path) -> None:
    """Let robots and bridges fail; what is in the file is not tried again."""
    done = {(line["fault"], line["number"]): line for _, line in lines_of(out)}
    for fault in chosen or faults.FAULTS:
        for number in range(count):
            if (fault, number) not in done:
                found = faults.trial(fault, number, seed)
                click.echo(f"{fault} {number}: {found.after_s:.2f} s, {found.ended}: {found.why}", err=True)
                done[fault, number] = {"number": number, **vars(found)}
                append(out, done[fault, number])
    trials = [faults.Trial(**{k: v for k, v in line.items() if k != "number"}) for line in done.values()]
    click.echo(faults.table(faults.rows(trials)))


if __name__ == "__main__":
    main()
