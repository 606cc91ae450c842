"""Three examples for the help of every command, the plainest first."""

from __future__ import annotations

from collections.abc import Mapping

import click

_PARTS = ("policy", "detector", "navigator", "checker", "node")  # that `mpvi new` writes in Python
_TRACE = "runs/picking_up_trash_0_0.trace.jsonl"

# Words of a command, and what may stand behind them.
EXAMPLES: Mapping[str, tuple[str, str, str]] = {
    "run": (
        "picking_up_trash --instance 1",
        "picking_up_trash --picture way.png --video run.mp4",
        "--dry --tree fetch --param to=sofa",
    ),
    "plan": (
        "picking_up_trash",
        "tidying_bedroom --planner openai:gemini-2.5-flash --out plan.json",
        '"Bring the cup to the sofa." --planner openai:gemini-2.5-flash',
    ),
    "compile": (
        "picking_up_trash",
        "picking_up_trash --out my_tree.yaml",
        "plan.json --on-failure retry:2",
    ),
    "render": (
        "fetch --param to=sofa",
        "my_tree.yaml --out my_tree.svg",
        f"{_TRACE} --out run.html",
    ),
    "calibrate": (
        "runs/watched",
        "runs/watched --alpha 0.05 --out reactive.json",
        "runs/watched --json",
    ),
    "train": (
        "learned demos --out mine.npz",
        "learned demos --out first.npz --actor-steps 500",
        "learned demos --out mine.npz --seed 1 --json",
    ),
    "new": (
        "tree my_tree",
        "skill stash --like place_in",
        "object gnome --like bottle --synset toy_figure.n.01",
    ),
    "new tree": ("my_tree", "my_tree --root ~/robot", "my_tree --json"),
    "new skill": ("stash", "dust --like wipe", "stash --like place_in --root ~/robot"),
    "new object": ("hammer", "vase --like bottle", "my_mug --mesh mug.glb --scale 0.01"),
    "new robot": ("mine --urdf robot.urdf", "mine --urdf robot.urdf --base holonomic", "mine --urdf robot.urdf --json"),
    "new house": ("mine --seed 7", "flat --root ~/robot --json", "theirs --from house.json"),
    "new task": ("clear_the_table", "clear_the_table --root ~/robot", "clear_the_table --json"),
    **{f"new {kind}": (f"my_{kind}", f"my_{kind} --root src", f"my_{kind} --json") for kind in _PARTS},
    "show": ("trash_can --out can.jpg", "picking_up_trash --out house.png", "--page docs/families.md"),
    "check": (
        "my_tree.yaml",
        "trees tasks",
        "my_tree.yaml --task picking_up_trash --json",
    ),
    "edit": ("my_tree.yaml", "my_tree.yaml --serve 9000", "trees/fetch.yaml --serve 0.0.0.0:9000"),
    "fmt": (
        "my_tree.yaml",
        "--diff my_tree.yaml",
        "--check trees",
    ),
    "schema": (
        "",
        "tree > trees/schema/tree.json",
        "rules > rules.json",
    ),
    "convert": (
        "fetch",
        "my_tree.yaml my_tree.xml",
        "their_tree.xml trees/their_tree.yaml",
    ),
    "watch": (
        _TRACE,
        f"{_TRACE} --serve 9000",
        "runs/trash10 --serve 0.0.0.0:9000",
    ),
    "replay": (
        _TRACE,
        f"{_TRACE} --tick 61",
        f"{_TRACE} --json",
    ),
    "explain": (
        _TRACE,
        "runs/trash10/traces/picking_up_trash_3_0.jsonl",
        f"{_TRACE} --json",
    ),
    "diff": (
        "runs/fetch_dry.trace.jsonl other/fetch_dry.trace.jsonl",
        "a.jsonl b.jsonl",
        "a.jsonl b.jsonl --json",
    ),
    "suite": (
        "run smoke",
        "status smoke",
        "report smoke --html smoke.html",
    ),
    "suite run": (
        "smoke",
        "trash10 --policy openpi:ws://localhost:8000 --out runs/mine",
        "behavior30 --task picking_up_trash --instance 0 --video",
    ),
    "suite status": (
        "smoke",
        "runs/mine",
        "smoke --json",
    ),
    "suite report": (
        "smoke",
        "runs/mine --html mine.html",
        "ablation6 --baseline e2e --markdown ablation6.md",
    ),
    "dataset": (
        "demos --out datasets/trash",
        "demos --all --out datasets/all --json",
        "demos --format v2.1 --like behavior --out datasets/comet",
    ),
    "train eyes": (
        "data --check check --out mine.npz",
        "data --check check --out try.npz --first-steps 500",
        "data --check check --out mine.npz --seed 1 --json",
    ),
    "train learned": (
        "data --out mine.npz",
        "data --out mine.npz --seed 1 --json",
        "data --out try.npz --actor-steps 500 --proposer-steps 500",
    ),
    "serve": (
        "reactive",
        "reactive --host 0.0.0.0 --port 8001",
        "mpvi --protocol behavior-2026 --detector grounding_dino",
    ),
    "ros2": (
        "--robot r1 --bridge house --tree hello --allow-motion",
        "--robot r1 --bridge house --task picking_up_trash --allow-motion",
        "house picking_up_trash",
    ),
    "ros2 house": ("picking_up_trash", "picking_up_trash --robot r1pro", "picking_up_trash --instance 2 --json"),
    "mcp": ("", "--allow-motion --out runs/agent", "--serve 8421 --allow-motion"),
    "evaluate": (
        "picking_up_trash --dialect behavior-2026 --labels",
        "picking_up_trash --dialect behavior-2025 --instance 1",
        "picking_up_trash gpu-box:8000 --dialect openpi --on-demand",
    ),
    "list": (
        "tasks",
        "tasks --long",
        "backends",
    ),
    "doctor": (
        "",
        "--json",
        "|| echo no episode can run here",
    ),
}


def with_examples(command: click.Command, words: str) -> click.Command:
    """The command, its help ending in examples, and likewise its commands.

    Args:
        command: Any; those without examples stay as they are.
        words: That call it, such as "suite run".
    """
    if words in EXAMPLES:
        lines = [f"mpvi {words} {example}".rstrip() for example in EXAMPLES[words]]
        command.epilog = "\n".join(("\b", "Examples:", *(f"  {line}" for line in lines)))
    for name, inner in getattr(command, "commands", {}).items():
        with_examples(inner, f"{words} {name}")
    return command
