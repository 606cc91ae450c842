"""The site of the documentation: every page is in its index, every link leads somewhere, and it builds."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from tests import commands_page
from tests.browser import BROWSER, browser

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


def test_the_page_of_commands_is_as_they_are() -> None:
    """It has the help of each command and option; `python -m tests.commands_page` writes it."""
    assert (DOCS / "commands.md").read_text(encoding="utf-8") == commands_page.text()


def test_the_quick_start_of_the_landing_page_works(tmp_path: Path) -> None:
    """Its commands behind the set-up, one after another, in an empty folder; a page of the run is there at the end."""
    text = (DOCS / "index.md").read_text(encoding="utf-8")
    first, *blocks = re.findall(r"^```sh\n(.*?)^```$", text, flags=re.MULTILINE | re.DOTALL)
    assert first.startswith("make demo")
    environment = {**os.environ, "PATH": f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"}
    command = ["bash", "-euo", "pipefail", "-c", "".join(blocks)]
    done = subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr[-3000:]
    assert (tmp_path / "my_robot" / "my_tree.html").exists()


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The site, as `make docs` builds it: a warning is an error."""
    pytest.importorskip("sphinx_book_theme")
    folder = tmp_path_factory.mktemp("site")
    command = [sys.executable, "-m", "sphinx", "-W", "--keep-going", "-q", "-b", "html", str(DOCS), str(folder)]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr[-3000:]
    return folder


@pytest.mark.rare
def test_every_page_fits_a_phone(site: Path, tmp_path: Path) -> None:
    """No page is wider than 390 px: long code in a line wraps, and tables scroll in themselves."""
    if BROWSER is None:
        pytest.skip("needs Chromium")
    wide = []
    with browser(tmp_path) as running:
        tab = running.tab("about:blank")
        tab.size(390, 800)
        for page in sorted(site.rglob("*.html")):
            if "_static" not in page.parts:
                tab.open(page.as_uri())
                tab.until(f"document.readyState === 'complete' && location.href === '{page.as_uri()}'")
                wide += [page.name] * (tab.eval("document.documentElement.scrollWidth") > 390)
    assert wide == []


@pytest.mark.rare
def test_the_site_loads_nothing_from_elsewhere(site: Path) -> None:
    """Scripts, styles and pictures come along, the film too."""
    assert (site / "_static" / "film.mp4").exists()
    for page in site.rglob("*.html"):
        text = page.read_text(encoding="utf-8")
        assert 'href="file:' not in text, page.name  # "file:line:col" in a docstring, taken for an address
        assert not re.findall(r"<(?:script|link|img)[^>]+(?:src|href)=\"https?://[^\"]+\"", text), page.name
