"""Formulas as MathML, written when the pages are built: readers need neither JavaScript nor a network."""

import re
from html import escape

from docutils import nodes
from docutils.utils.math import MathError
from docutils.utils.math.latex2mathml import tex2mathml
from sphinx.application import Sphinx
from sphinx.util import logging
from sphinx.util.typing import ExtensionMetadata
from sphinx.writers.html5 import HTML5Translator

_LOGGER = logging.getLogger(__name__)

# What docutils reads in another way than LaTeX does: 12 as one number in a fraction without braces, and an
# accent as the base of limits.
_MISREAD = re.compile(r"\\[dt]?frac\s*[^{\s]|\\(?:bar|ddot|dot|hat|tilde)\s*(?:\\[a-zA-Z]+|\w)\s*\}?\s*[_^]")

# An index of a letter with an accent stands below the letter in docutils; it belongs behind it.
_ACCENT = re.compile(
    r"<munderover>\s*(<mi>\w</mi>)\s*((?:(?!munderover).)*?)\s*"
    r"(<mo stretchy=\"false\">[ˉ˙ˆ˜¨]</mo>)\s*</munderover>",
    re.DOTALL,
)
_POWER = re.compile(
    r"<msup>\s*<msub>(<mover accent=\"true\">.*?</mover>)((?:(?!</msub>).)*)</msub>\s*(.*?)\s*</msup>",
    re.DOTALL,
)

# Greek capitals are upright in LaTeX, which tells the capital gamma from the small one at a glance.
_CAPITAL = re.compile(r"<mi(?: class=\"capital-greek\")?>([\u0393-\u03a9])</mi>")

# The names of functions have room to both sides in LaTeX, and none in browsers.
_FUNCTION = re.compile(r"<mi>\w{2,}</mi>\s*<mo>&ApplyFunction;</mo>")
_THIN = '<mspace width="0.17em"></mspace>'


def _formula(node: nodes.math | nodes.math_block) -> str:
    """Translate from LaTeX; what cannot be is a warning, and shown as it is written."""
    text = node.astext()
    try:
        if found := _MISREAD.search(text):
            raise MathError(f"write {found.group()!r} with braces")
        formula = tex2mathml(text, as_block=isinstance(node, nodes.math_block))
        formula = _ACCENT.sub(r'<msub><mover accent="true">\1\3</mover>\2</msub>', formula)
        formula = _POWER.sub(r"<msubsup>\1\2\3</msubsup>", formula)
        formula = _CAPITAL.sub(r'<mi mathvariant="normal">\1</mi>', formula)
        return _FUNCTION.sub(rf"{_THIN}\g<0>{_THIN}", formula)
    except MathError as error:
        _LOGGER.warning("formula %r: %s", text, error, location=node)
        return f"<code>{escape(text)}</code>"


def _inline(translator: HTML5Translator, node: nodes.math) -> None:
    translator.body.append(_formula(node))
    raise nodes.SkipNode


def _block(translator: HTML5Translator, node: nodes.math_block) -> None:
    translator.body.append(f'<div class="formula">{_formula(node)}</div>\n')
    raise nodes.SkipNode


def setup(app: Sphinx) -> ExtensionMetadata:
    """Offer the renderer; `html_math_renderer = "mathml"` chooses it."""
    app.add_html_math_renderer("mathml", (_inline, None), (_block, None))
    return {"parallel_read_safe": True, "parallel_write_safe": True}
