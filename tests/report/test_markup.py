"""Texts become markup that shows them and nothing else."""

from html.parser import HTMLParser

from hypothesis import given
from hypothesis import strategies as st

from cadtof_cli.report.markup import Markup, element, table, text
from cadtof_cli.units import printable


class _Reader(HTMLParser):
    """The elements and texts of markup, as Python's HTML parser sees them."""

    def __init__(self) -> None:
        super().__init__(convert_charrefs=True)
        self.tags: list[str] = []
        self.attributes: list[tuple[str, str | None]] = []
        self.shown = ""

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append(tag)
        self.attributes += attrs

    def handle_data(self, data: str) -> None:
        self.shown += data

    def handle_comment(self, data: str) -> None:
        raise AssertionError(data)


def _read(markup: str) -> _Reader:
    reader = _Reader()
    reader.feed(markup)
    reader.close()
    return reader


HOSTILE = st.one_of(
    st.text(),
    st.sampled_from(
        [
            "</script><script>alert(1)</script>",
            "<!--",
            "\"' onload=x",
            "&lt;b&gt;",
            "]]>",
            "\ud800",
            "a\u202eb",
            "$title",
            "<svg/onload=x>",
        ]
    ),
)


@given(HOSTILE, HOSTILE)
def test_a_text_stays_a_text(name: str, reason: str) -> None:
    read = _read(element("p", name, title=reason))
    assert read.tags == ["p"]
    assert read.shown == printable(name)
    assert read.attributes == [("title", printable(reason))]


@given(HOSTILE)
def test_a_table_has_the_cells_that_it_was_given(name: str) -> None:
    read = _read(table((name, "b"), [(name, name)], caption=name, numbers=(1,)))
    assert read.tags == ["h3", "div", "table", "thead", "tr", "th", "th", "tbody", "tr", "th", "td"]
    assert read.shown == f"{printable(name) * 2}b{printable(name) * 2}"


def test_invisible_characters_are_escaped() -> None:
    assert text("a\u202eb\x00c\udce9") == "a\\u202eb\\x00c\\udce9"
    assert text("Größe ∞ 日本") == "Größe ∞ 日本"
    assert printable("a\nb") == "a\\nb"


def test_markup_stays_markup_and_attributes_may_be_left_out() -> None:
    assert (
        element("p", Markup("<b>x</b>"), hidden=True, title=None, id=0, class_="a")
        == '<p hidden id="0" class="a"><b>x</b></p>'
    )
    assert element("img", alt="") == '<img alt="">'
