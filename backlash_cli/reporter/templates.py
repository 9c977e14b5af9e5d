"""The templates of all reports, and the words they have in common: every public function of the modules of words."""

from __future__ import annotations

from functools import cache
from typing import TYPE_CHECKING, Any

from . import explain_words, parameter_words, safe, words

if TYPE_CHECKING:
    import jinja2


@cache
def environment(kind: str) -> jinja2.Environment:
    """Return the environment of "html" or "txt" templates, in which foreign text is harmless wherever it is put.

    Functions of words are both filters and functions of the templates.
    """
    import jinja2
    from markupsafe import Markup

    def shown(value: Any) -> Any:
        # | parts the cells of a table on a terminal
        return value if isinstance(value, Markup) else Markup(safe.terminal(value).replace("|", "\x1f"))

    made = jinja2.Environment(
        loader=jinja2.PackageLoader("backlash_cli.reporter"), autoescape=True, undefined=jinja2.StrictUndefined,
        trim_blocks=True, lstrip_blocks=True, finalize=shown if kind == "txt" else None,
    )
    for module in (words, parameter_words, explain_words, safe):
        own = {name: value for name, value in vars(module).items() if not name.startswith("_")}
        made.globals |= own
        made.filters |= {name: value for name, value in own.items() if callable(value)}
    return made
