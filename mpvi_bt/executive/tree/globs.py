"""Nodes of a tree by a glob over their paths.

`*` is any text, slashes too, and `?` one character. What has neither is a path, and means the node there. Of siblings
of one name ("navigate", "navigate#2") a glob means all, unless it has a "#" itself. A "*/" at the start may stand for
nothing: "*/say" is every node named "say", the root too.
"""

from __future__ import annotations

import re
from fnmatch import fnmatchcase

from mpvi_bt.executive.tree.spec import TreeSpec
from mpvi_bt.ground.errors import UserError, nearest

_AGAIN = re.compile(r"#\d+(?=/|$)")


def fits(glob: str, path: str) -> bool:
    """Whether the node at `path` is meant."""
    if not _has_wildcards(glob):
        return glob == path
    glob = glob.replace("[", "[[]")  # brackets are no wildcards here: labels have them
    forms = (path,) if "#" in glob else (path, _AGAIN.sub("", path))
    return any(fnmatchcase(form, glob) or fnmatchcase("/" + form, glob) for form in forms)


def matching(glob: str, tree: TreeSpec) -> list[str]:
    """Paths of the nodes that are meant, in the order of the tree."""
    return [node.path for node in tree.nodes if fits(glob, node.path)]


def no_match(glob: str, tree: TreeSpec) -> str:
    """The message for a glob that fits no node, with the closest path or "*/" and a name."""
    near = None if _has_wildcards(glob) else nearest(glob, (node.path for node in tree.nodes))
    if near is None:
        names = {_AGAIN.sub("", node.path.rpartition("/")[2]): None for node in tree.nodes}
        last = glob.rpartition("/")[2].strip("*?")
        of_kind = [node.path for node in tree.nodes if node.spec.kind == last]  # paths have names, not kinds
        name = nearest(last, names)
        near = of_kind[0] if of_kind and last not in names else f"*/{name}" if name else None
    return f"no node of tree {tree.name!r} fits {glob!r}." + (f" Did you mean {near!r}?" if near else "")


def require_match(glob: str, tree: TreeSpec, what: str) -> list[str]:
    """As `matching`, but the glob must fit a node; `what`: the option it came from, such as "--break".

    Raises:
        UserError: It fits none.
    """
    if not (paths := matching(glob, tree)):
        raise UserError(f"{what}: {no_match(glob, tree)} `mpvi render TREE --json` lists the paths.")
    return paths


def _has_wildcards(glob: str) -> bool:
    return "*" in glob or "?" in glob
