"""The documentation is whole: pages are in the tree, names in the API, scenarios in the gallery.

`make docs` checks all else, as it takes warnings for errors.
"""

import ast
import importlib.util
import re
from base64 import b64decode
from pathlib import Path
from types import ModuleType

import pytest
from docutils import nodes

from aimd_des import BroadcastChannel, Resource, Study, __version__
from aimd_des.lowlevel import Run
from aimd_des.results.measures import FIRST, MEASURES
from aimd_des.theory import Prediction, predict
from scenarios.common.command import command
from tests.test_public_names import FACES, TOP

ROOT = Path(__file__).resolve().parents[1]
DOCS = ROOT / "docs"
MADE = {"_build", "_examples", "gallery"}
FINDINGS = DOCS / "findings"  # parts of pages in the gallery
PAGES = sorted(
    path
    for path in DOCS.rglob("*")
    if path.suffix in {".md", ".rst"} and not MADE & set(path.relative_to(DOCS).parts)
)


def extension(name: str) -> ModuleType:
    spec = importlib.util.spec_from_file_location(name, DOCS / "_extensions" / f"{name}.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def entries(page: str) -> list[str]:
    """What the toctrees of a page name, in Markdown or reStructuredText."""
    fenced = re.findall(r"^```\{toctree\}\n(.*?)^```", page, re.MULTILINE | re.DOTALL)
    indented = re.findall(r"^\.\. toctree::\n((?:   .*\n|\n)*)", page, re.MULTILINE)
    lines = (line.strip() for block in [*fenced, *indented] for line in block.splitlines())
    return [line for line in lines if line and not line.startswith(":")]


def test_every_page_is_in_the_tree_once() -> None:
    listed = [
        (page.parent / entry).relative_to(DOCS).as_posix()
        for page in PAGES
        for entry in entries(page.read_text(encoding="utf-8"))
    ]
    assert len(listed) == len(set(listed))
    there = {page.relative_to(DOCS).with_suffix("").as_posix() for page in PAGES if page.parent != FINDINGS}
    assert there - set(listed) == {"index"}
    assert set(listed) - there == {"gallery/index"}  # which is made


def test_toctrees_are_read() -> None:
    assert entries("```{toctree}\n:hidden:\n\na\nb/c\n```\n\n```python\nd\n```\n") == ["a", "b/c"]
    assert entries("A\n=\n\n.. toctree::\n   :maxdepth: 1\n\n   a\n   b\n\nText\n") == ["a", "b"]


def public_names() -> set[str]:
    """Every public name as users write it: from the top where it is there, else from its face."""
    top = set(TOP.split())
    inner = {f"{face}.{name}" for face in FACES for name in FACES[face].split() if name not in top}
    return {f"aimd_des.{name}" for name in (top - set(FACES)) | inner}


def test_every_public_name_is_in_the_api() -> None:
    text = "\n".join(path.read_text(encoding="utf-8") for path in (DOCS / "api").glob("*.rst"))
    described = set(
        re.findall(r"^\.\. (?:auto(?:class|data|function|exception)|py:data):: ([\w.]+)$", text, re.MULTILINE)
    )
    listed = set(re.findall(r"^   ((?:aimd_des|models)\.[\w.]+)$", text, re.MULTILINE))
    assert len(public_names()) > 80
    ours = {name for name in described if name.startswith("aimd_des.")}
    assert public_names() == ours
    values = set(
        re.findall(r"^\.\. (?:auto|py:)data:: ([\w.]+)$", text, re.MULTILINE)
    )  # no docstring to list
    assert described - listed <= values | {"models.random_convex.random_optimum"}
    assert listed - described == set()


def test_the_page_on_design_shows_the_wings_as_they_are() -> None:
    wings = extension("wings")
    below = wings.arrows(ROOT / "aimd_des")
    text = (DOCS / "design.md").read_text(encoding="utf-8")
    rows = re.findall(r"^\| `(\w+)` \| .+? \| ?(.*?) ?\|$", text, re.MULTILINE)
    assert {wing: set(re.findall(r"\w+", others)) for wing, others in rows} == wings.needed(below)
    assert max(wings.floors(below).values()) == 9, "a wing that imports less stands lower"
    assert "wings of aimd_des on nine floors" in text
    drawn = wings.PICTURE.read_text(encoding="utf-8")
    assert drawn == wings.picture(below), "draw it anew: python docs/_extensions/wings.py"


def test_the_diagrams_of_the_model_are_as_they_are_drawn() -> None:
    diagrams = extension("diagrams")
    again = "draw them anew: python docs/_extensions/diagrams.py"
    assert diagrams.SYSTEM.read_text(encoding="utf-8") == diagrams.system(), again
    assert diagrams.TIMELINE.read_text(encoding="utf-8") == diagrams.timeline(), again


def test_the_timeline_follows_the_rules_of_the_model() -> None:
    diagrams = extension("diagrams")
    pieces, signals = diagrams._pieces()
    one, two, three = signals
    totals = dict(diagrams._curve(pieces, 0)[::-1])  # at a jump the value before it
    assert totals[0.0] == 7.5
    assert one == pytest.approx((diagrams.CAPACITY - 7.5) / 2.0)
    assert two > one + diagrams.HOLD_OFF  # demand is below the capacity when the first hold-off ends
    assert three == pytest.approx(two + diagrams.HOLD_OFF)  # and above it when the second does
    last = next(piece for piece in reversed(pieces) if piece.start <= three)
    assert last.first + last.second + 2.0 * (three - last.start) > diagrams.CAPACITY


def test_the_citation_has_the_version_and_the_paper() -> None:
    citation = (ROOT / "CITATION.cff").read_text(encoding="utf-8")
    assert f"\nversion: {__version__}\n" in citation
    page = (DOCS / "howto" / "publish.md").read_text(encoding="utf-8")
    assert f"version = {{{__version__}}}" in page
    (doi,) = re.findall(r"\n    doi: (\S+)\n", citation)
    assert f"doi       = {{{doi}}}" in page


def test_wings_stand_on_floors_and_arrows_go_through_gaps() -> None:
    wings = extension("wings")
    below: dict[str, set[str]] = {"a": set(), "b": {"a"}, "c": {"a", "b"}, "d": {"a"}, "e": {"c", "d"}}
    assert wings.floors(below) == {"a": 1, "b": 2, "d": 2, "c": 3, "e": 4}
    assert wings.needed(below) == {"a": set(), "b": {"a"}, "c": {"b"}, "d": {"a"}, "e": {"c", "d"}}
    assert ["e", "e>d@3", "d"] in wings.chains(below)
    heights = {node: y for node, (_, y) in wings.middles(below).items()}
    assert heights["e"] < heights["c"] == heights["e>d@3"] < heights["b"] == heights["d"] < heights["a"]
    with pytest.raises(ValueError, match=r"a circle of imports among \['a', 'b'\]"):
        wings.floors({"a": {"b"}, "b": {"a"}, "c": set()})


SCENARIOS = extension("scenario_gallery").sources(ROOT / "scenarios")


@pytest.mark.parametrize("name", SCENARIOS)
def test_every_scenario_has_a_page_in_the_gallery(name: str) -> None:
    text, code = SCENARIOS[name]
    script = ast.parse(extension("scenario_gallery").example(name, text, code, DOCS))
    title, line, *rest = (ast.get_docstring(script) or "").splitlines()
    assert line == "=" * len(title)
    page = "\n".join(rest)
    for part in ("include:: /_examples/findings/{}.md", "python -m scenarios.{}", "/downloads/{}.ipynb"):
        assert part.format(name) in page
    figure = DOCS / "images" / f"{name}.png"
    assert figure.is_file(), "draw it, and keep the figure of the full size in docs/images"
    # All of the code is shown, and nothing else: the docstring is the page.
    whole = ast.parse(code.read_text(encoding="utf-8"))
    assert [ast.dump(node) for node in script.body[1:]] == [ast.dump(node) for node in whole.body[1:]]


def test_findings_are_of_scenarios_that_have_no_page_of_their_own() -> None:
    own = {"convergence", "paper", "theory_table"}
    assert {page.stem for page in FINDINGS.iterdir()} == set(SCENARIOS) - own
    for page in FINDINGS.iterdir():
        text = page.read_text(encoding="utf-8")
        assert text.startswith(f"# `{page.stem}`\n\n![")
        assert f"](../images/{page.stem}.png)\n" in text


def test_the_index_names_every_scenario_once() -> None:
    index = (DOCS / "scenarios.md").read_text(encoding="utf-8")
    named = re.findall(r"^\[`(\w+)`\]\((?:findings/)?\1\.md\)$", index, re.MULTILINE)
    assert sorted(named) == list(SCENARIOS)


@pytest.mark.parametrize("name", ["delay", "paper", "theory_table"])  # a module, a page, a folder
def test_scripts_and_notebooks_to_download_run_the_study(name: str) -> None:
    gallery = extension("scenario_gallery")
    text, code = SCENARIOS[name]
    source = code.read_text(encoding="utf-8")
    script = gallery.script(name, text, code, DOCS)
    assert script.startswith(source)
    assert script.count("\n    main()\n") == 1
    ran = dict.fromkeys(["__name__"], "__main__") | {"main": lambda: ran.update(done=True)}
    exec(compile(ast.Module(ast.parse(script).body[-1:], []), name, "exec"), ran)
    assert ran["done"]
    cells = gallery.notebook(name, text, code, DOCS)["cells"]
    page, run, show, listing = cells
    picture = (DOCS / "images" / f"{name}.png").read_bytes()
    assert b64decode(page["attachments"][f"{name}.png"]["image/png"]) == picture
    assert f"](attachment:{name}.png)" in page["source"]
    assert not re.search(r"\]\((?!attachment:)", page["source"])  # no link that leads nowhere
    assert source in listing["source"]
    assert run["source"].startswith(f"from scenarios.{name} import main\n\nmain([")
    options = ast.literal_eval(run["source"].partition("main(")[2].partition(", standalone_mode=False)")[0])
    assert f'main = command("{name}", ' in source  # it takes long to import
    assert command(name, print, "").make_context(name, options).params["out"] == Path("quick", name)
    assert f'Path("quick/{name}")' in show["source"]


def test_links_to_findings_lead_to_the_gallery() -> None:
    gallery = extension("scenario_gallery")
    page = "[a](findings/delay.md) [b](../findings/loss.md) [c](findings.md) `findings/x.md`"
    assert gallery.link_to_gallery(page) == (
        "[a](gallery/delay.rst) [b](../gallery/loss.rst) [c](findings.md) `findings/x.md`"
    )


def test_modules_and_folders_are_scenarios() -> None:
    text, code = SCENARIOS["theory_table"]
    assert (text.name, code.name) == ("__init__.py", "study.py")
    assert SCENARIOS["delay"][0] == SCENARIOS["delay"][1]
    assert "common" not in SCENARIOS


def test_a_scenario_without_findings_is_refused(tmp_path: Path) -> None:
    gallery = extension("scenario_gallery")
    (tmp_path / "new.py").write_text('"""Why?\n\nBecause.\n"""\n')
    with pytest.raises(gallery.ExtensionError, match=r"findings/new\.md: is missing"):
        gallery.example("new", tmp_path / "new.py", tmp_path / "new.py", tmp_path)


def slugs(page: str) -> set[str]:
    """Anchors of the headings of a Markdown page, as forges and MyST make them."""
    prose = re.sub(r"^```.*?^```", "", page, flags=re.MULTILINE | re.DOTALL)
    titles = re.findall(r"^#+ (.*)$", prose, re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", title.lower()).replace(" ", "-") for title in titles}


def broken_links(path: Path) -> list[str]:
    """Relative links of a Markdown page, as the forge resolves them, that lead nowhere."""
    page = re.sub(r"^```.*?^```", "", path.read_text(encoding="utf-8"), flags=re.MULTILINE | re.DOTALL)
    broken = []
    for target in re.findall(r"\]\(([^)\s]+)\)", page):
        if "://" in target:
            continue
        file, _, anchor = target.partition("#")
        there = path.parent / file if file else path
        if not there.exists() or (anchor and anchor not in slugs(there.read_text(encoding="utf-8"))):
            broken.append(target)
    return broken


@pytest.mark.parametrize(
    "page",
    [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *(page for page in PAGES if page.suffix == ".md")],
    ids=lambda path: str(path.relative_to(ROOT)),
)
def test_links_of_the_forge_lead_somewhere(page: Path) -> None:
    assert broken_links(page) == []


def test_a_link_that_leads_nowhere_is_found(tmp_path: Path) -> None:
    page = tmp_path / "page.md"
    page.write_text(
        "# One, two\n[a](#one-two) [b](#three) [c](no.md) [d](page.md#one-two) [e](https://doi.org)\n"
    )
    assert broken_links(page) == ["#three", "no.md"]


@pytest.mark.parametrize("text", [r"\tfrac12\lambda", r"\dot x_i", r"{\dot x}_i", r"\unheardof"])
def test_formulas_that_would_be_misread_are_refused(text: str) -> None:
    seen: list[str] = []
    mathml = extension("mathml")
    mathml._LOGGER = type("Log", (), {"warning": lambda self, *words, **_: seen.append(words[0])})()
    assert mathml._formula(nodes.math(text, text)).startswith("<code>")
    assert len(seen) == 1
    assert mathml._formula(nodes.math("x", r"\frac{1}{2}\,\dot{x}")).startswith("<math")
    assert len(seen) == 1


def test_signatures_have_the_hints_of_the_source_with_links() -> None:
    written = extension("signatures").signature
    capacity = "increase: float | FloatArray, decrease: float | FloatArray, normalization: float"
    assert written("class", Resource)[0].startswith(
        f"(name: str, capacity: float, {capacity}, threshold: float = 1.0"
    )
    assert written("class", BroadcastChannel)[0].startswith(
        "(latency: ~aimd_des.latency.Latency | ArrayLike = Constant(0.0), loss:"
    )
    assert "axes: list[~aimd_des.study.Axis] = []" in written("class", Study)[0]
    taken, returned = written("function", predict)
    assert taken.startswith(
        "(problem: ~aimd_des.Problem, dynamics: Literal['discrete', 'continuous'] = 'discrete', *,"
    )
    assert returned == "~aimd_des.theory.Prediction"
    assert written("method", Run.save) == ("(path: str | Path)", "")
    assert written("class", Prediction) == ("", "")  # users do not make it


def test_greek_letters_are_spelled_in_prose_alone() -> None:
    lines = ["alpha_i > 0, `beta` and Gamma.", "lambda, mu : float", ".. math::", "", "    alpha", "mu"]
    assert extension("signatures")._spell(lines) == [
        r":math:`\alpha_{i}` > 0, `beta` and :math:`\Gamma`.",
        *lines[1:-1],
        r":math:`\mu`",
    ]


@pytest.mark.parametrize("accent", ["bar", "dot", "hat"])
def test_indices_stand_behind_a_letter_with_an_accent(accent: str) -> None:
    mathml = extension("mathml")
    once = "".join(mathml._formula(nodes.math("", rf"\{accent}{{x}}_i")).split())
    assert "munderover" not in once
    assert re.search(r"<msub><moveraccent=\"true\"><mi>x</mi><mo[^>]*>.</mo></mover><mi>i</mi></msub>", once)
    both = "".join(mathml._formula(nodes.math("", rf"\{accent}{{x}}_i^j \lambda_i^j")).split())
    assert re.search(r"<msubsup><mover.*?</mover><mi>i</mi><mi>j</mi></msubsup><msubsup><mi>λ</mi>", both)
    assert "<munderover>" in mathml._formula(nodes.math_block("", r"\sum_{i=1}^n x_i"))


@pytest.mark.parametrize(
    ("part", "what"),
    [
        ('<p role="heading">Guides</p>', "heading without a level"),
        ('<a href="x.html"><img src="x.png" alt=""></a>', "link without a name x.html"),
        ("<table><tr><th></th><th>p</th></tr></table>", "header of a table without a text"),
        ("<dl><dd>x</dd></dl>", "list of definitions without a term"),
        ('<img src="x.png">', "picture x.png without a text"),
        ('<aside class="a"></aside><aside class="b"></aside>', "asides without names of their own"),
        ('<p id="x"></p><p id="x"></p>', "id x twice"),
        ("<h1>Another</h1>", "2 headings of level 1"),
    ],
)
def test_the_build_tells_what_a_page_lacks_for_those_who_do_not_see_it(part: str, what: str) -> None:
    missing = extension("accessible").missing
    whole = (
        '<h1 id="t">Title</h1><p role="heading" aria-level="2">A</p><aside aria-label="All pages"></aside>'
        '<aside aria-label="This page"></aside><a href="x.html"><img src="x.png" alt="A figure"></a><a></a>'
        "<table><tr><th><math><mi>p</mi></math></th></tr></table>"
        "<dl><dt>x</dt><dd>y</dd></dl>"
    )
    assert missing(whole) == []
    assert missing(whole + part) == [what]


def test_greek_capitals_are_upright_and_small_letters_are_not() -> None:
    formula = extension("mathml")._formula(nodes.math("", r"\Gamma \gamma \Delta"))
    assert re.findall(r"<mi[^/]*</mi>", formula) == [
        '<mi mathvariant="normal">Γ</mi>',
        "<mi>γ</mi>",
        '<mi mathvariant="normal">Δ</mi>',
    ]


def test_the_page_on_the_model_says_of_each_measure_what_the_table_says() -> None:
    page = (ROOT / "docs" / "model.md").read_text(encoding="utf-8")
    rows = "".join(f"| `{one.name}` | {one.unit} | {one.meaning} |\n" for one in MEASURES.values())
    assert f"|---|---|---|\n{rows}\n" in page
    assert set(FIRST) <= set(MEASURES)
