"""The site of the documentation: every page is in its index, every link leads somewhere, and it builds."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import pytest

from mpvi_bt.cli import COMMANDS

ROOT = Path(__file__).parent.parent
DOCS = ROOT / "docs"
PAGES = sorted(DOCS.rglob("*.md"))
TEXTS = [*PAGES, ROOT / "README.md", ROOT / "CONTRIBUTING.md"]
LINK = re.compile(r"\]\((?!https?:)(?P<file>[^)#\s]*)(?:#(?P<anchor>[^)]+))?\)")
FENCED = re.compile(r"^```.*?^```$", re.MULTILINE | re.DOTALL)


def prose(page: Path) -> str:
    """The page without its blocks of code."""
    return FENCED.sub("", page.read_text(encoding="utf-8"))


def anchors(page: Path) -> set[str]:
    """What the page's headings are linked by, as GitHub and Sphinx name them."""
    headings = re.findall(r"^#+ (.+)$", prose(page), flags=re.MULTILINE)
    plain = (re.sub(r"\[([^]]*)\]\([^)]*\)", r"\1", heading).lower() for heading in headings)
    return {re.sub(r"[^\w\- ]", "", heading).replace(" ", "-") for heading in plain}


@pytest.mark.parametrize("page", TEXTS, ids=lambda page: str(page.relative_to(ROOT)))
def test_no_link_is_dead(page: Path) -> None:
    """Each link to a file of ours finds it, and each link to a heading a heading."""
    for link in LINK.finditer(prose(page)):
        target = page.parent / link["file"] if link["file"] else page
        assert target.exists(), link[0]
        if link["anchor"]:
            assert link["anchor"] in anchors(target), link[0]


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_what_a_page_plays_is_there(page: Path) -> None:
    """Files that the HTML in a page names are where it says, in the repository as on the site."""
    for file in re.findall(r"<[^>]*?\b(?:src|href|poster)=\"(?!https?:)([^\"#]+)\"", prose(page)):
        assert (page.parent / file).exists(), file


def test_every_page_is_in_the_index() -> None:
    """The index by reader lists each page once: it is the site's navigation."""
    listed = re.findall(r"^- \[[^]]+\]\(([^)]+)\)", (DOCS / "index.md").read_text(encoding="utf-8"), flags=re.MULTILINE)
    assert sorted(listed) == sorted(str(p.relative_to(DOCS)) for p in PAGES if p.name != "index.md" or p.parent != DOCS)


def test_every_command_has_its_reference() -> None:
    """The page of commands has each command of the command line, in its order."""
    page = (DOCS / "commands.md").read_text(encoding="utf-8")
    assert re.findall(r"^\.\. click:: (\S+)$", page, flags=re.MULTILINE) == [where for where, _ in COMMANDS.values()]


@pytest.mark.rare
def test_the_site_builds_without_a_warning(tmp_path: Path) -> None:
    """What `make docs` calls ends with 0 where every warning is an error, and loads nothing from elsewhere."""
    pytest.importorskip("sphinx_book_theme")
    done = subprocess.run(
        [sys.executable, "-m", "sphinx", "-W", "--keep-going", "-q", "-b", "html", str(DOCS), str(tmp_path)],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr[-3000:]
    assert (tmp_path / "_static" / "film.mp4").exists()
    for page in tmp_path.rglob("*.html"):
        text = page.read_text(encoding="utf-8")
        assert 'href="file:' not in text, page.name  # "file:line:col" in a docstring, taken for an address
        assert not re.findall(r"<(?:script|link|img)[^>]+(?:src|href)=\"https?://[^\"]+\"", text), page.name
