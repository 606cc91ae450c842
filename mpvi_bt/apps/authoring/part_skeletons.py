"""Parts in Python to begin with, as `mpvi new` writes them: each runs as it is, by the command in its first lines."""

from __future__ import annotations

import importlib.util
from pathlib import Path

from mpvi_bt.apps.authoring.skeletons import Skeleton, checked_name, free_name
from mpvi_bt.executive.behaviors.registry import node_types
from mpvi_bt.ground.errors import UserError


def new_part(kind: str, name: str) -> Skeleton:
    """A policy, detector, navigator or checker, in a module of that name.

    Raises:
        UserError: The name is none, or that of a module that is installed.
    """
    made = _class_name(kind, name, {})
    run = f"mpvi run picking_up_trash --{kind} {name}:{made} --no-watch"
    first = (f"python ROOT/{name}.py",) if "__main__" in _PARTS[kind] else ()
    return Skeleton({f"{name}.py": _PARTS[kind].format(name=name, made=made, run=run)}, (*first, run))


def new_node(name: str) -> Skeleton:
    """A node in a file beside a tree that has it. Raises as `new_part`."""
    made = _class_name("node", name, dict.fromkeys(node_types(), "a node that is there"))
    tree = f"trees/try_{name}.yaml"
    files = {
        f"trees/{name}.py": _NODE.format(name=name, made=made),
        tree: f"tree: try_{name}\nnodes: {name}.py\nroot:\n  {name}: 5\n",
    }
    return Skeleton(files, (f"mpvi check ROOT/{tree}", f"mpvi run --dry --tree ROOT/{tree}"))


def _class_name(kind: str, name: str, taken: dict[str, str]) -> str:
    checked_name(kind, name, taken)
    if kind != "node" and importlib.util.find_spec(name) is not None and not Path(f"{name}.py").exists():
        free = free_name(kind, name, [name])
        raise UserError(f"{name}: a Python module of that name is installed; {free!r} is free.")
    return "".join(word.capitalize() for word in name.split("_"))


_POLICY = '''\
"""A policy: a prompt, pictures and proprioception go in, a chunk of actions comes out (docs/policies.md).

{run}
"""

import numpy as np


class {made}:
    """Stands still. What it may ask for when it is made: skills, vocabulary, detector, seed.

    Attributes:
        name: In results.
        cameras: That it wants pictures of: "head", "left", "right".
    """

    name = "{name}"
    cameras = ("head",)

    def __init__(self, seed):
        self.random = np.random.default_rng(seed)

    def reset(self):
        """Forget the last prompt: a new unit begins."""

    def infer(self, observation):
        """(N, 23) actions for the next N steps of 1/30 s; docs/observations.md has the keys and the layout."""
        observation["prompt"], observation["proprioception"], observation["images"].get("head")
        held = np.array(observation["command"])  # (23,) what the robot was told last: joints are absolute targets
        held[:3] = 0  # the base's velocity
        return np.tile(held, (10, 1))


if __name__ == "__main__":
    from mpvi_bt.testing import check_policy

    check_policy({made}(seed=0))
    print("keeps the contract of policies")
'''

_DETECTOR = '''\
"""A detector: a picture and phrases go in, what is where comes out (docs/detectors.md).

{run}
"""

import numpy as np

from mpvi_bt.finding.perception.detector import Detection


class {made}:
    """Takes each patch of bright red for what is asked for. It may ask for vocabulary and seed when it is made.

    Attributes:
        name: In results.
    """

    name = "{name}"

    def detect(self, image, phrases):
        """A list of detections; `image.rgb` is (H, W, 3) of 0 to 255."""
        red, green, blue = (image.rgb[..., channel].astype(int) for channel in range(3))
        mask = (red > 150) & (green < 60) & (blue < 60)
        if not phrases or mask.sum() < 30:
            return []
        rows, columns = np.nonzero(mask)
        box = np.array([columns.min(), rows.min(), columns.max() + 1, rows.max() + 1])
        return [Detection(phrases[0], 0.5, box, mask)]


if __name__ == "__main__":
    from mpvi_bt.testing import check_detector

    check_detector({made})
    print("keeps the contract of detectors")
'''

_NAVIGATOR = '''\
"""A navigator: drives the base to what a phrase names (docs/policies.md).

{run}
"""


class {made}:
    """Hands every drive to ours, and counts them. It may ask for robot, ours and seed when it is made.

    One that drives by itself gives the robot a command a step: `robot.act(action)`, with the velocity of the base in
    the first three numbers (docs/observations.md).
    """

    def __init__(self, robot, ours):
        self.robot, self.ours, self.drives = robot, ours, 0

    def start(self, target, room):
        """Begin a drive to `target`, such as "trash can"; `room` narrows the search, or is None."""
        self.drives += 1
        self.ours.start(target, room)

    def step(self):
        """Command the robot for one step of 1/30 s, and report the progress of the drive."""
        return self.ours.step()

    def stop(self):
        """Let the base stand still."""
        self.ours.stop()
'''

_CHECKER = '''\
"""A completion checker: a criterion and a picture go in, yes or no comes out (docs/policies.md).

{run}
"""

from mpvi_bt.ground.protocols import Judgement


class {made}:
    """Says no to everything. It may ask for vocabulary and seed when it is made.

    Attributes:
        name: In results.
        needs_image: Whether it wants the picture of the head's camera.
    """

    name = "{name}"
    needs_image = True

    def check(self, criterion, image):
        """Whether a state such as "the can of soda is in the trash can" is so; `image.rgb` is what the head sees."""
        return Judgement(False, "nothing was looked for")


if __name__ == "__main__":
    from mpvi_bt.testing import check_checker

    check_checker({made}())
    print("keeps the contract of checkers")
'''

_PARTS = {"policy": _POLICY, "detector": _DETECTOR, "navigator": _NAVIGATOR, "checker": _CHECKER}

_NODE = '''\
"""A node of trees in this folder, which name this file under `nodes:` (docs/own_nodes.md).

    mpvi run --dry --tree try_{name}.yaml
"""

from py_trees.common import Status

from mpvi_bt.executive.behaviors.node import Leaf


class {made}(Leaf):
    """Counts down, one a tick, then succeeds."""

    def __init__(self, name: str, times: int = 3) -> None:
        super().__init__(name)
        self.times = times

    def initialise(self) -> None:
        """Begin a round."""
        super().initialise()
        self.left = self.times

    def update(self) -> Status:
        """One tick: RUNNING, SUCCESS, or `self.fail(reason, what was seen)`."""
        self.left -= 1
        self.feedback_message = f"{{self.left}} to go"
        return Status.RUNNING if self.left else Status.SUCCESS
'''
