"""Pages: escaped, self-contained, safe scripts, readable structure."""

import base64
import gzip
import hashlib
import json
import re
from html.parser import HTMLParser

import jinja2
import numpy as np
import pytest

from backlash_cli.reporter import templates
from backlash_cli.reporter.page import page as whole
from tests.reporter.reports import HOSTILE

FIGURE = {"data": [{"x": np.arange(3), "y": [1.0, float("nan"), float("inf")], "name": "</script><b>"}], "layout": {}}


class Reader(HTMLParser):
    """Collects elements with their attributes, and the text of scripts."""

    def __init__(self, html: str) -> None:
        super().__init__()
        self.elements: list[tuple[str, dict[str, str | None]]] = []
        self.scripts: list[str] = []
        self.open: list[str] = []
        self.feed(html)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.elements.append((tag, dict(attrs)))
        if tag not in ("meta", "link", "input", "img", "br"):
            self.open.append(tag)
        if tag == "script":
            self.scripts.append("")

    def handle_endtag(self, tag: str) -> None:
        assert self.open and self.open[-1] == tag, f"</{tag}> does not close {self.open[-3:]}"
        self.open.pop()

    def handle_data(self, data: str) -> None:
        if self.open and self.open[-1] == "script":
            self.scripts[-1] += data

    def named(self, tag: str) -> list[dict[str, str | None]]:
        return [attributes for name, attributes in self.elements if name == tag]


def unpacked(script: str) -> str:
    """What the browser makes of a packed script."""
    return gzip.decompress(base64.b64decode(script, validate=True)).decode()


def page(title: str, body: str, **content: object) -> str:
    """A page whose template is `body`, with the parts of all pages."""
    environment = templates.environment("html").overlay()
    imports = '{% from "parts.html" import section, table, td, paragraphs with context %}'
    loader = jinja2.ChoiceLoader([jinja2.DictLoader({"test.html": imports + body}), environment.loader])
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(environment, "loader", loader)
        patch.setattr("backlash_cli.reporter.page.environment", lambda kind: environment)
        return whole("test.html", title, **content)


FULL = """
{% call section("Overview") %}{{ paragraphs(names) }}
{% call(n) table("Overview", ["Loop", "Size", "x", "y", "z"], names or ["FIC101"], choices="Loop") %}
{{ td(n) }}{{ td(0.03, "3 %", mark="bad") }}{{ td(1.5) }}{{ td(none) }}{{ td(true) }}
{% endcall %}{% endcall %}
{% for n in names %}
{% call section(n, note=n, anchor="a" ~ loop.index, folded=true, brief=n) %}{{ section(n, deeper=1) }}{% endcall %}
{% endfor %}
{{ section("Figure", figure, "one") }}
"""


def full(*names: str) -> str:
    return page(names[0] if names else "T", FULL, names=names, figure=FIGURE, subtitle="s",
                back=("../index.html", "All loops"))


@pytest.fixture(scope="module")
def hostile() -> str:
    return full(*HOSTILE)


def test_hostile_names_are_text(hostile):
    read = Reader(hostile)
    assert not read.open
    assert not read.named("img") and not read.named("b")
    assert [s.get("type") for s in read.named("script")] == ["application/gzip", "application/gzip", None]
    for name in ("<script>alert(1)", "</script><b>", "</script><img", "<img"):
        assert name not in hostile


def test_no_event_handlers_and_no_foreign_addresses(hostile):
    for tag, attributes in Reader(hostile).elements:
        assert not [a for a in attributes if a.startswith("on")], tag
        for key in ("src", "href"):
            assert not re.match(r"(https?:)?//|javascript:", attributes.get(key) or ""), (tag, attributes)


def test_policy_allows_the_two_scripts_by_fingerprint_and_nothing_from_outside(hostile):
    read = Reader(hostile)
    policy = next(m["content"] for m in read.named("meta") if m.get("http-equiv") == "Content-Security-Policy")
    assert policy is not None and policy.startswith("default-src 'none'")
    assert "http" not in policy and "unsafe-eval" not in policy
    scripts = policy.split("script-src ")[1].split(";")[0]
    assert "unsafe-inline" not in scripts
    for script in (unpacked(read.scripts[1]), read.scripts[2]):
        digest = base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()
        assert f"'sha256-{digest}'" in scripts


def test_figure_data_is_strict_json(hostile):
    (data,) = json.loads(unpacked(Reader(hostile).scripts[0]), parse_constant=pytest.fail)
    assert data["data"][0] == {"x": [0, 1, 2], "y": [1.0, None, None], "name": "</script><b>"}


def test_plotly_figures_are_taken_too():
    import plotly.graph_objects as go

    html = page("T", '{{ section("F", f) }}', f=go.Figure(FIGURE))
    assert json.loads(unpacked(Reader(html).scripts[0]))[0]["data"][0]["name"] == "</script><b>"


def test_figures_keep_the_order_of_the_page_and_the_library_is_packed():
    drawn = {name: {"data": [], "layout": {"name": name}} for name in "abcd"}
    html = page("T", """
{{ section("a", f.a) }}
{% call section("s") %}{{ section("b", f.b, deeper=1) }}{{ section("c", f.c, deeper=1) }}{% endcall %}
{{ section("d", f.d) }}""", f=drawn)
    read = Reader(html)
    assert [f["aria-label"] for f in read.named("figure")] == [*"abcd"]
    assert [f["layout"]["name"] for f in json.loads(unpacked(read.scripts[0]))] == [*"abcd"]
    assert len(html) < 2_100_000 and "Plotly" in unpacked(read.scripts[1])


def test_without_figures_the_plotting_library_stays_out():
    assert len(page("T", '{% call section("S") %}words{% endcall %}')) < 20_000


def test_the_library_may_stand_beside_the_page():
    html = page("T", '{{ section("F", f) }}', f=FIGURE, plotly_file="plotly.js")
    assert len(html) < 30_000 and Reader(html).named("script")[1] == {"src": "plotly.js"}


def test_structure_for_readers_of_all_kinds():
    read = Reader(full("FIC101"))
    assert read.named("html")[0]["lang"] == "en"
    assert [t for t, _ in read.elements].count("h1") == 1
    assert any(m.get("name") == "viewport" for m in read.named("meta"))
    assert len(read.named("main")) == 1 and all(th.get("scope") == "col" for th in read.named("th"))
    assert [f["aria-label"] for f in read.named("figure")] == ["Figure"]
    assert "Overview, table" in {d.get("aria-label") for d in read.named("div")}


def test_cells_sort_by_value_and_show_text():
    html = full("FIC101")
    assert '<td class="number" data-key="0.03"><span class="mark bad">3 %</span></td>' in html
    assert '<td class="short" data-key="">–</td>' in html and '<td class="short" data-key="yes">yes</td>' in html
