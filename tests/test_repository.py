"""What a repository on a forge has beside its code: each of these files fits the project that it stands in."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import pytest
import yaml

from mpvi_bt import __version__

ROOT = Path(__file__).parent.parent
FORMS = sorted((ROOT / ".github" / "ISSUE_TEMPLATE").glob("*.yml"))
MAKEFILE = (ROOT / "Makefile").read_text(encoding="utf-8")


def _load(path: str | Path) -> Any:
    return yaml.safe_load((ROOT / path).read_text(encoding="utf-8"))


def test_the_workflow_runs_what_ci_runs() -> None:
    """Its last step is `.ci/run`, on the Python that the project asks for, within CI's time."""
    (job,) = _load(".github/workflows/ci.yml")["jobs"].values()
    python = next(step["with"]["python-version"] for step in job["steps"] if "setup-python" in step.get("uses", ""))
    assert job["steps"][-1]["run"] == ".ci/run"
    assert f'requires-python = ">={python}"' in (ROOT / "pyproject.toml").read_text(encoding="utf-8")
    assert job["timeout-minutes"] == 90


def test_the_workflow_may_only_read() -> None:
    """A pull request of a stranger gets no right to write."""
    assert _load(".github/workflows/ci.yml")["permissions"] == {"contents": "read"}


def test_hooks_are_programs_of_the_environment() -> None:
    """Each hook runs a program that `make setup-test` installs, so that its version is that of constraints.txt."""
    (repository,) = _load(".pre-commit-config.yaml")["repos"]
    programs = {hook["entry"].split()[0] for hook in repository["hooks"]}
    assert repository["repo"] == "local"
    assert programs == {".venv/bin/ruff", ".venv/bin/mpvi"}
    assert "VENV ?= .venv" in MAKEFILE


def test_the_hook_checks_every_file_that_check_knows() -> None:
    """Its pattern takes each shipped tree, skill and task, and none of another folder."""
    (repository,) = _load(".pre-commit-config.yaml")["repos"]
    pattern = next(hook["files"] for hook in repository["hooks"] if hook["id"] == "mpvi-check")
    for folder in ("trees", "skills", "tasks"):
        for path in (ROOT / folder).rglob("*.yaml"):
            assert re.search(pattern, str(path.relative_to(ROOT)))
    assert not re.search(pattern, "policies/mpvi.yaml")


def test_the_citation_is_of_this_version() -> None:
    """It has what the format asks for, and the version of the package."""
    citation = _load("CITATION.cff")
    assert {"cff-version", "message", "title", "authors"} <= set(citation)
    assert citation["version"] == __version__
    assert citation["license"] == "MIT"


@pytest.mark.parametrize("form", [path for path in FORMS if path.name != "config.yml"], ids=lambda path: path.stem)
def test_issue_forms_have_what_forges_ask_for(form: Path) -> None:
    """A name, a description, and fields that each have a label."""
    read = _load(form)
    assert {"name", "description", "body"} <= set(read)
    assert all(field["attributes"]["label"] for field in read["body"])
    names = [field["id"] for field in read["body"]]
    assert len(names) == len(set(names))


def test_the_image_is_set_up_by_make() -> None:
    """The Dockerfile runs a target of the Makefile, puts its environment on the path, and ends in `mpvi doctor`."""
    lines = (ROOT / "Dockerfile").read_text(encoding="utf-8").splitlines()
    (target,) = re.findall(r"^RUN make ([\w-]+)", "\n".join(lines), flags=re.MULTILINE)
    home = next(line.split()[1] for line in lines if line.startswith("WORKDIR"))
    assert re.search(rf"^{target}:", MAKEFILE, flags=re.MULTILINE)
    assert f"ENV PATH={home}/.venv/bin:$PATH" in lines
    assert lines[-1] == 'CMD ["mpvi", "doctor"]'


def test_the_image_takes_no_environment_from_outside() -> None:
    """What a checkout has beside its tracked files stays out of the image."""
    left_out = (ROOT / ".dockerignore").read_text(encoding="utf-8").split()
    assert {".git", ".venv", "runs"} <= set(left_out)
