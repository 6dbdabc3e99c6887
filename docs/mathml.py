"""A Sphinx extension that writes equations as MathML, which browsers draw by themselves: no JavaScript, no network."""

import re
from html import unescape
from typing import Any
from xml.etree import ElementTree

from docutils import nodes
from docutils.utils.math import MathError
from docutils.utils.math.latex2mathml import tex2mathml
from sphinx.application import Sphinx
from sphinx.errors import ExtensionError
from sphinx.writers.html5 import HTML5Translator

_NAMESPACE = "http://www.w3.org/1998/Math/MathML"
_NAMED = re.compile(r"&(?!amp;|lt;|gt;|quot;)[A-Za-z]+;")
"""Characters by names that HTML has and XML does not."""
_ACCENTS = ("˙", "¨", "ˆ", "~", "˜", "¯", "→")


def _inline(self: HTML5Translator, node: nodes.math) -> None:
    self.body.append(_mathml(node, as_block=False))
    raise nodes.SkipNode


def _block(self: HTML5Translator, node: nodes.math_block) -> None:
    self.body.append(f'<div class="equation">{_mathml(node, as_block=True)}</div>\n')
    raise nodes.SkipNode


def _mathml(node: nodes.Element, *, as_block: bool) -> str:
    try:
        return with_accents(str(tex2mathml(node.astext(), as_block=as_block)))
    except MathError as error:
        raise ExtensionError(f"{node.source}:{node.line}: {error}; the equation is {node.astext()!r}") from error


def with_accents(mathml: str) -> str:
    """The same with subscripts beside letters that have a dot or a hat: docutils puts them below such letters."""
    ElementTree.register_namespace("", _NAMESPACE)
    tree = ElementTree.fromstring(_NAMED.sub(lambda found: unescape(found[0]), mathml))
    for element in tree.iter(f"{{{_NAMESPACE}}}munderover"):
        letter, below, above = element
        if above.text in _ACCENTS:
            accented = ElementTree.Element(f"{{{_NAMESPACE}}}mover", {"accent": "true"})
            accented.extend([letter, above])
            element.tag = f"{{{_NAMESPACE}}}msub"
            element[:] = [accented, below]
    return ElementTree.tostring(tree, encoding="unicode")


def setup(app: Sphinx) -> dict[str, Any]:
    """Called by Sphinx."""
    app.add_html_math_renderer("mathml", inline_renderers=(_inline, None), block_renderers=(_block, None))
    return {"parallel_read_safe": True, "parallel_write_safe": True}
