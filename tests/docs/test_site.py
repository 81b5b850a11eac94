"""The documentation site builds without a warning, every link in it leads somewhere, and nothing in it needs the network."""

import re
from pathlib import Path

import pytest
from docs_site.links import broken_links
from docs_site.stage import anchor

from tests.support.commands import every_command
from tests.support.needed import needed_module
from tests.support.run_cadtof import ROOT
from tests.support.vision import contrast


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The built site."""
    for module in ("sphinx", "furo", "myst_parser", "latex2mathml", "click_man"):
        needed_module(module)
    from docs import build

    folder = tmp_path_factory.mktemp("site") / "site"
    problems = build(folder)
    assert not problems, "\n".join(problems)
    return folder


def test_every_page_is_in_the_contents(site: Path) -> None:
    contents = (site / "index.html").read_text()
    sidebar = contents.partition("sidebar-tree")[2].partition("</aside>")[0]
    for page in sorted((ROOT / "docs").rglob("*.md")):
        name = page.relative_to(ROOT / "docs").with_suffix(".html").as_posix()
        assert f'href="{name}"' in sidebar, f"{name} is in no chapter"
    assert {f"{page}.html" for page in ("tour", "capture", "accuracy", "security")} <= set(
        re.findall(r'href="([^"#]+)"', sidebar)
    )


def test_pages_can_be_used_with_a_screen_reader_and_with_keys(site: Path) -> None:
    """WCAG 2.1: 4.1.2, headings have a level; 2.1.1, what scrolls can be reached; 1.4.3, code has enough contrast."""
    for page in site.rglob("*.html"):
        assert not re.search(r'role="heading"(?! aria-level)', page.read_text()), page.name
    tour = (site / "tour.html").read_text()
    assert tour.count('<pre tabindex="0">') >= 3
    assert "<pre>" in tour
    style = (site / "_static" / "pygments.css").read_text()
    ground = re.search(r"^\.highlight \{ background: (#\w{6})", style, re.MULTILINE)
    colours = re.findall(r"^\.highlight \.\w+ \{ color: (#\w{6})", style, re.MULTILINE)
    assert ground is not None
    assert len(colours) > 20
    assert min(contrast(colour, ground[1]) for colour in colours) >= 4.5


def test_every_section_of_the_readme_is_on_the_site(site: Path) -> None:
    pages = "".join(
        (site / f"{page}.html").read_text() for page in ("index", "tour", "capture", "accuracy", "commands/index")
    )
    for heading in re.findall(r"(?m)^## (.+)$", (ROOT / "README.md").read_text()):
        assert f">{heading}<" in pages, heading


def test_links_between_pages_show_titles_not_names_of_files(site: Path) -> None:
    for page in site.rglob("*.html"):
        assert not re.search(r'<span class="[^"]*doc">[^<]*\.md<', page.read_text()), page.name


@pytest.mark.parametrize("words", every_command())
def test_a_command_has_a_page_with_all_its_options(site: Path, words: str) -> None:
    command = every_command()[words]
    page = (site / "commands" / f"cadtof-{words.replace(' ', '-')}.html").read_text()
    for param in command.params:
        for name in param.opts if param.param_type_name == "option" else ():
            assert re.search(rf"(?<![\w-]){re.escape(name)}(?![\w-])", page), name
    assert "Example" in page


def test_equations_are_mathml_and_need_no_script(site: Path) -> None:
    page = (site / "physics.html").read_text()
    assert page.count("<math") > 50
    assert not re.search(r"<script[^>]*(mathjax|katex)", page, re.IGNORECASE)


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ('<a href="gone.html">x</a>', "gone.html leads nowhere"),
        ('<a href="#gone">x</a>', "#gone has no such anchor"),
        ('<a href="b.html#gone">x</a>', "b.html#gone has no such anchor"),
        ('<script src="https://example.org/x.js"></script>', "loads https://example.org/x.js"),
        ('<a href="b.html#there">x</a> <a href="https://example.org">x</a> <img src="b.html">', ""),
    ],
)
def test_a_broken_link_is_found(tmp_path: Path, text: str, problem: str) -> None:
    (tmp_path / "a.html").write_text(text)
    (tmp_path / "b.html").write_text('<p id="there">')
    found = list(broken_links(tmp_path))
    assert (problem in found[0]) if problem else not found


def test_a_style_that_loads_from_the_network_is_found(tmp_path: Path) -> None:
    (tmp_path / "a.css").write_text("p { background: url('https://example.org/x.png') }")
    assert list(broken_links(tmp_path)) == ["a.css: loads from the network"]


def _links(page: Path) -> list[str]:
    text = re.sub(r"```.*?```|`[^`\n]*`", "", page.read_text(encoding="utf-8"), flags=re.DOTALL)
    return [target for target in re.findall(r"\]\(([^)\s]+)\)", text) if "://" not in target]


@pytest.mark.parametrize(
    "page",
    [ROOT / "README.md", ROOT / "CHANGELOG.md", ROOT / "SECURITY.md", *sorted((ROOT / "docs").rglob("*.md"))],
    ids=lambda page: page.relative_to(ROOT).as_posix(),
)
def test_links_of_a_page_lead_somewhere_in_the_repository(page: Path) -> None:
    for target in _links(page):
        path, _, heading = target.partition("#")
        linked = page.parent / path if path else page
        assert linked.exists(), f"{target} leads nowhere"
        if heading and linked.suffix == ".md":
            headings = re.findall(r"(?m)^#+ (.+)$", linked.read_text(encoding="utf-8"))
            assert heading in {anchor(one) for one in headings}, f"{target} has no such heading"


@pytest.mark.parametrize(
    "page",
    [ROOT / "README.md", ROOT / "CONTRIBUTING.md", ROOT / "SECURITY.md", *sorted((ROOT / "docs").rglob("*.md"))],
    ids=lambda page: page.relative_to(ROOT).as_posix(),
)
def test_files_of_the_source_that_a_page_names_exist(page: Path) -> None:
    """A name is a path in the repository or in the package. A name in capitals stands for any file."""
    files = [
        path.as_posix() for folder in ("cadtof_cli", "scripts", "tests", "docs") for path in (ROOT / folder).rglob("*")
    ]
    for name in re.findall(r"`(\w[\w/]*/\w+\.(?:py|c|h))\b", page.read_text(encoding="utf-8")):
        if not re.search(r"[A-Z]{3}", name):
            assert any(file.endswith(f"/{name}") for file in files), f"{name} is nowhere"
