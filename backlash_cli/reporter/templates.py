"""The templates of all reports, and the words they have in common: every public function of the modules of words."""

from __future__ import annotations

from functools import cache, partial
from typing import TYPE_CHECKING, Any

from .. import record
from . import parameter_words, safe, words

if TYPE_CHECKING:
    import jinja2


@cache
def environment(kind: str) -> jinja2.Environment:
    """Return the environment of "html" or "txt" templates, in which foreign text is harmless wherever it is put.

    Functions of words are both filters and functions of the templates; the sentences are functions. Those are templates
    of the environment "words", which leaves everything as it is.
    """
    import jinja2
    from markupsafe import Markup

    def shown(value: Any) -> Any:
        # | parts the cells of a table on a terminal; terminal() lets nothing through that stands for it here
        return value if isinstance(value, Markup) else Markup(safe.terminal(value).replace("|", "\ue000"))

    made = jinja2.Environment(
        loader=jinja2.PackageLoader("backlash_cli.reporter"), autoescape=kind != "words",
        undefined=jinja2.StrictUndefined, trim_blocks=True, lstrip_blocks=True,
        finalize=shown if kind == "txt" else None,
    )
    for module in (words, parameter_words, safe, record):
        own = {name: value for name, value in vars(module).items() if name.isupper() or (
            callable(value) and value.__module__.startswith("backlash_cli"))}
        made.globals |= own
        made.filters |= {name: value for name, value in own.items() if callable(value)}
    if kind != "words":
        own = vars(environment("words").get_template("sentences.txt").module)
        made.globals |= {name: partial(sentence, name) for name in own if not name.startswith("_")}
        made.globals["lines"] = lines
    return made


def lines(name: str, *about: Any) -> list[str]:
    """Return the lines that sentences.txt has under this name."""
    said = getattr(environment("words").get_template("sentences.txt").module, name)(*about)
    return [line for line in said.splitlines() if line.strip()]


def sentence(name: str, *about: Any) -> str:
    """Return them as one text, as they are: foreign names in it are made harmless where it is put."""
    return " ".join(" ".join(lines(name, *about)).split())
