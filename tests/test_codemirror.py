"""The editor component that ships is the one that its sources in the repository make."""

from __future__ import annotations

import hashlib
import json
import re
from pathlib import Path

ROOT = Path(__file__).parent.parent
SOURCES = ROOT / "scripts" / "editor"
BUNDLE = (ROOT / "mpvi_bt" / "apps" / "watch" / "page" / "codemirror.js").read_text(encoding="utf-8")


def digest(*parts: bytes) -> str:
    return hashlib.sha256(b"".join(parts)).hexdigest()


def test_the_bundle_belongs_to_its_sources() -> None:
    """Who changes them runs `make editor`; nobody changes the bundle by hand."""
    head, _, code = BUNDLE.partition("*/\n")
    names = ("build.mjs", "codemirror.js", "package-lock.json", "package.json")
    assert re.findall(r"^(\w+): ([0-9a-f]{64})$", head, re.M) == [
        ("sources", digest(*((SOURCES / name).read_bytes() for name in names))),
        ("code", digest(code.encode())),
    ]


def test_the_bundle_has_the_license_of_each_package_in_it() -> None:
    """With its version, as the lockfile has it."""
    head = BUNDLE.partition("*/\n")[0]
    locked = json.loads((SOURCES / "package-lock.json").read_text(encoding="utf-8"))["packages"]
    named = re.findall(r"((?:@[a-z]+/)?[a-z][a-z0-9-]*) (\d+\.\d+\.\d+)(?=[,:])", head)
    assert all(locked[f"node_modules/{name}"]["version"] == version for name, version in named)
    assert {"codemirror", "@codemirror/view", "@lezer/yaml", "style-mod"} <= {name for name, _ in named}
    assert head.count("Permission is hereby granted") >= 1


def test_the_lockfile_names_no_host() -> None:
    """It pins packages by their digests, from whatever registry a machine asks."""
    lock = (SOURCES / "package-lock.json").read_text(encoding="utf-8")
    assert "resolved" not in lock
    assert lock.count('"integrity"') > 10
