"""Makes trees draw themselves in Python: `print` shows text, a notebook a picture."""

from __future__ import annotations

import base64
from html import escape

from mpvi_bt.executive.drawing.svg import svg_tree
from mpvi_bt.executive.drawing.text import ascii_tree
from mpvi_bt.executive.tree.spec import TreeSpec, draw_by


def tree_html(tree: TreeSpec) -> str:
    """The drawing as an image, so that its styles stay its own on a page of other things."""
    data = base64.b64encode(svg_tree(tree).encode()).decode()
    alt = escape(f"tree {tree.name}", quote=True)
    return f'<img src="data:image/svg+xml;base64,{data}" alt="{alt}" style="max-width:100%;height:auto">'


draw_by(ascii_tree, tree_html)
