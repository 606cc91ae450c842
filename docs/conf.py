"""Sphinx builds the site from these pages: `make docs` (CONTRIBUTING.md says why Sphinx)."""

from __future__ import annotations

import importlib
import re
from pathlib import Path

from sphinx.application import Sphinx

from mpvi_bt import __version__

project = "mpvi_bt"
author = "The mpvi_bt maintainers"
copyright = "MIT license"  # the theme's footer
version = release = __version__

extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.napoleon", "sphinx.ext.viewcode"]
root_doc = "index"
exclude_patterns = ["_build"]
suppress_warnings = ["ref.python"]  # an attribute of several classes, named without its class

myst_heading_anchors = 4
myst_enable_extensions = ["fieldlist"]

autodoc_member_order = "bysource"
autodoc_typehints = "signature"
autodoc_type_aliases = {name: name for name in ("Array", "File", "Key", "Side", "Value")}
python_maximum_signature_line_length = 100
napoleon_google_docstring = True
napoleon_numpy_docstring = False
napoleon_use_ivar = True
napoleon_attr_annotations = False  # a pydantic pattern is no reStructuredText

html_theme = "sphinx_book_theme"
html_title = "mpvi_bt"
html_theme_options = {"navbar_persistent": [], "use_download_button": False, "use_fullscreen_button": False}
html_static_path = ["_static"]
html_css_files = ["site.css"]
html_copy_source = False

SECTION = re.compile(r"^## (?P<title>.+)\n(?P<body>(?:(?!## ).*\n?)*)", re.MULTILINE)
PAGE = re.compile(r"^- \[(?P<name>[^\]]+)\]\((?P<page>[\w/]+)\.md\)", re.MULTILINE)


def navigation(app: Sphinx, page: str, source: list[str]) -> None:
    """Make the index by reader the site's navigation: a tree of pages for each of its sections, in its order.

    A page that the index forgets is a warning of Sphinx, and so an error of `make docs`.
    """
    if page != root_doc:
        return
    for section in SECTION.finditer(source[0]):
        pages = [f"{name} <{page}>" for name, page in PAGE.findall(section["body"])]
        lines = ["```{toctree}", ":hidden:", f":caption: {section['title']}", "", *pages, "```", ""]
        source[0] += "\n" + "\n".join(lines)


TICKS = re.compile(r"(?<!`)`([^`\n]+)`(?!`)")


def as_restructured(app: Sphinx, what: str, name: str, obj: object, options: object, lines: list[str]) -> None:
    """Docstrings are plain text with names in single backticks: make them what Sphinx reads."""
    for i, line in enumerate(lines):
        pieces = TICKS.split(line)
        pieces[::2] = [re.sub(r"([*|])|(?<=\w)_(?!\w)", r"\\\g<0>", text) for text in pieces[::2]]
        pieces[1::2] = [f"``{code}``" for code in pieces[1::2]]
        lines[i] = "".join(pieces)
    for i, (line, blank, block) in enumerate(zip(lines, lines[1:], lines[2:], strict=False)):
        if line and not line.startswith(" ") and not blank and block.startswith("    "):
            lines[i] = f"{line}\n\n::"  # what is indented is code, or a table of plain text


def setup(app: Sphinx) -> None:
    """Called by Sphinx."""
    for page in (Path(__file__).parent / "api").glob("*.md"):  # before autodoc imports them as for a type checker
        for module in re.findall(r"automodule:: (\S+)", page.read_text(encoding="utf-8")):
            importlib.import_module(module)
    app.connect("source-read", navigation)
    app.connect("autodoc-process-docstring", as_restructured, priority=100)
